/* Square matrices of the design's size; smaller ones fill the upper left and leave the rest zero. */
#ifndef MATRIX_H
#define MATRIX_H

#include "law.h"

typedef struct {
    double of[N][N];
} Matrix;

static inline Matrix identity(void)
{
    Matrix I = {{{0.0}}};
    for (int i = 0; i < N; i++)
        I.of[i][i] = 1.0;
    return I;
}

static inline Matrix transposed(const Matrix *A)
{
    Matrix T;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            T.of[j][i] = A->of[i][j];
    return T;
}

/* c A + B */
static inline Matrix sum(double c, const Matrix *A, const Matrix *B)
{
    Matrix S;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            S.of[i][j] = c * A->of[i][j] + B->of[i][j];
    return S;
}

static inline Matrix product(const Matrix *A, const Matrix *B)
{
    Matrix P = {{{0.0}}};
    for (int i = 0; i < N; i++)
        for (int k = 0; k < N; k++)
            for (int j = 0; j < N; j++)
                P.of[i][j] += A->of[i][k] * B->of[k][j];
    return P;
}

/* A B A' */
static inline Matrix congruent(const Matrix *A, const Matrix *B)
{
    const Matrix AB = product(A, B), T = transposed(A);
    return product(&AB, &T);
}

/* The largest absolute value; NaN if one is. */
static inline double largest(const Matrix *A)
{
    double most = 0.0;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            if (!(fabs(A->of[i][j]) <= most)) most = fabs(A->of[i][j]);
    return most;
}

/* The solution X of A X = B by Gaussian elimination with partial pivoting; not finite where A is singular. */
static inline Matrix solve(Matrix A, Matrix B)
{
    for (int k = 0; k < N; k++) {
        int pivot = k;
        for (int i = k + 1; i < N; i++)
            if (fabs(A.of[i][k]) > fabs(A.of[pivot][k])) pivot = i;
        for (int j = 0; j < N; j++) {
            const double a = A.of[k][j], b = B.of[k][j];
            A.of[k][j] = A.of[pivot][j], B.of[k][j] = B.of[pivot][j];
            A.of[pivot][j] = a, B.of[pivot][j] = b;
        }
        for (int i = k + 1; i < N; i++) {
            const double factor = A.of[i][k] / A.of[k][k];
            for (int j = 0; j < N; j++) {
                A.of[i][j] -= factor * A.of[k][j];
                B.of[i][j] -= factor * B.of[k][j];
            }
        }
    }
    for (int j = 0; j < N; j++)
        for (int i = N - 1; i >= 0; i--) {
            for (int k = i + 1; k < N; k++)
                B.of[i][j] -= A.of[i][k] * B.of[k][j];
            B.of[i][j] /= A.of[i][i];
        }
    return B;
}

#endif
