/* In the place of the header that the build of a linear controller writes: matrices that are read with a case. Those of
 * fewer states are filled up with zeros, which change no bit of a sum. */
#ifndef GAINS_H
#define GAINS_H

enum { ROWS = MOST_STATES + 2, POINTS = 1, CELLS = 1, IS_LINEAR = 0 };

typedef struct {
    unsigned corner[3];
    double inverse[2][2], origin[2];
} Cell;

static double T_S, LIMIT[2]; /* [s, N.m] */
static const double POINT[POINTS][2];
static const Cell CELL[CELLS];
static double LAW[POINTS][ROWS][ROWS], BACK[POINTS][2][ROWS]; /* by columns */

/* The number of states, the limits of the torques, [A B; C D] and the gain against windup, by rows. */
static const double *read_matrices(const double *given, double sample_time)
{
    const int states = (int)*given++, rows = states + 2;
    if (states < 0 || states > ROWS - 2) return 0;
    T_S = sample_time;
    LIMIT[0] = *given++;
    LIMIT[1] = *given++;
    for (int j = 0; j < ROWS; j++)
        for (int i = 0; i < ROWS; i++)
            LAW[0][j][i] = 0.0;
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < rows; j++)
            LAW[0][j < states ? j : j - states + ROWS - 2][i < states ? i : i - states + ROWS - 2] = *given++;
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < ROWS; i++)
            BACK[0][j][i] = 0.0;
    for (int i = 0; i < states; i++)
        for (int j = 0; j < 2; j++)
            BACK[0][j][i] = *given++;
    return given;
}

#endif
