#include "design.h"

#include <stdio.h>

#include "elementary.h"

/* Places in the state: angles and speeds of links and motors, torques that disturb motors and links. */
enum { Q_A = 0, Q_M = 2, W_A = 4, W_M = 6, JOINTS = 8, D = 8, F = 10 };

/* Table 1, nominal. */
static const double J_M[AXES] = {0.004, 0.001}, RATIO = 200.0;
static const double K_LOW[AXES] = {0.5e6, 0.2e6}, K_HIGH[AXES] = {1.5e6, 0.3e6};
static const double PSI_ARC_MINUTES[AXES] = {2.0, 3.0}, DAMPING[AXES] = {600.0, 200.0};
static const double J[AXES] = {5.0, 50.0}, M[AXES] = {50.0, 150.0};
static const double L[AXES] = {1.0, 1.5}, XI[AXES] = {0.5, 0.8};

typedef struct {
    double q_a[AXES], slope[AXES];
} Pose;

static double squared(double x) { return x * x; }

static double gear_deflection(int i, double load, double psi, double k_3)
{
    const double size = fabs(load), limit = (K_LOW[i] + k_3 * psi * psi) * psi;
    if (size > limit) return copysign(psi + (size - limit) / K_HIGH[i], load);
    double x = size / K_LOW[i];
    for (int n = 0; n < 50; n++) {
        const double change = ((K_LOW[i] + k_3 * x * x) * x - size) / (K_LOW[i] + 3.0 * k_3 * x * x);
        x -= change;
        if (fabs(change) <= 1e-15) break;
    }
    return copysign(x, load);
}

static Pose pose(const double q_m_ref[AXES], const double u_m0[AXES])
{
    Pose at;
    for (int i = 0; i < AXES; i++) {
        const double psi = PSI_ARC_MINUTES[i] * PI / (180.0 * 60.0);
        const double k_3 = (K_HIGH[i] - K_LOW[i]) / (3.0 * psi * psi);
        const double delta = gear_deflection(i, -RATIO * u_m0[i], psi, k_3);
        at.slope[i] = fmin(K_LOW[i] + 3.0 * k_3 * delta * delta, K_HIGH[i]);
        at.q_a[i] = q_m_ref[i] / RATIO + delta;
    }
    return at;
}

/* [[A, B], [0, 0]] of the linear model, its inputs being torques on motors, then on links. */
static Matrix linearize(const Weights *of, const Pose *at)
{
    const double a_2 = J[1] + M[1] * XI[1] * XI[1];
    const double a_1 = J[0] + M[0] * XI[0] * XI[0] + M[1] * L[0] * L[0] + a_2;
    const double coupling = M[1] * L[0] * XI[1] * elementary_sin(at->q_a[1]);
    const double j_11 = a_1 - 2.0 * coupling, j_12 = a_2 - coupling, determinant = j_11 * a_2 - j_12 * j_12;
    const double inverse[4][4] = {{a_2 / determinant, -j_12 / determinant},
                                  {-j_12 / determinant, j_11 / determinant},
                                  {0.0, 0.0, 1.0 / J_M[0]},
                                  {0.0, 0.0, 0.0, 1.0 / J_M[1]}};
    double spring[4][4] = {{0.0}}, damper[4][4] = {{0.0}};
    for (int i = 0; i < AXES; i++) {
        const double stiffness = of->stiffness[i] * K_LOW[i] * elementary_pow(at->slope[i] / K_LOW[i], of->hardening);
        double to_gear[4] = {0.0};
        to_gear[i] = 1.0;
        to_gear[AXES + i] = -1.0 / RATIO;
        for (int row = 0; row < 4; row++)
            for (int column = 0; column < 4; column++) {
                spring[row][column] += stiffness * to_gear[row] * to_gear[column];
                damper[row][column] += DAMPING[i] * to_gear[row] * to_gear[column];
            }
        damper[AXES + i][AXES + i] += of->friction[i];
    }
    Matrix model = {{{0.0}}};
    for (int row = 0; row < 4; row++) {
        model.of[row][W_A + row] = 1.0;
        for (int column = 0; column < 4; column++) {
            for (int k = 0; k < 4; k++) {
                model.of[W_A + row][column] -= inverse[row][k] * spring[k][column];
                model.of[W_A + row][W_A + column] -= inverse[row][k] * damper[k][column];
            }
            model.of[W_A + row][JOINTS + column] = inverse[row][(column + 2) % 4];
        }
    }
    return model;
}

static bool exponential(Matrix exponent, Matrix *result)
{
    const Matrix zero = {{{0.0}}};
    const double size = N * largest(&exponent); /* no norm is larger */
    if (!isfinite(size)) return false;
    int halvings = 0;
    (void)frexp(size, &halvings);
    halvings = halvings < 0 ? 0 : halvings + 1;
    exponent = sum(ldexp(1.0, -halvings), &exponent, &zero);
    Matrix term = *result = identity();
    for (int order = 1; order < 16; order++) {
        term = product(&term, &exponent);
        term = sum(1.0 / order, &term, &zero);
        *result = sum(1.0, result, &term);
    }
    while (halvings--)
        *result = product(result, result);
    return true;
}

/* X = A' X (1 + G X)^-1 A + H with G = B R^-1 B'. */
static bool riccati(Matrix A, Matrix G, Matrix H, Matrix *X)
{
    const Matrix one = identity();
    for (int n = 0; n < 60; n++) {
        Matrix W = product(&G, &H);
        W = sum(1.0, &W, &one);
        const Matrix inner = solve(W, A), T = transposed(&A), middle = solve(W, G), HI = product(&H, &inner);
        const Matrix change = product(&T, &HI), more = congruent(&A, &middle);
        const Matrix more_T = transposed(&more), change_T = transposed(&change);
        A = product(&A, &inner);
        G = sum(0.5, &more, &G);
        G = sum(0.5, &more_T, &G);
        H = sum(0.5, &change, &H);
        H = sum(0.5, &change_T, &H);
        const double size = largest(&H);
        if (!(size < 1e100)) return false;
        if (largest(&change) <= 1e-14 * size) {
            *X = H;
            return true;
        }
    }
    return false;
}

/* The inverse of a 2 x 2 matrix. */
static void invert(double m[AXES][AXES])
{
    const double determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0], m_00 = m[0][0];
    m[0][0] = m[1][1] / determinant;
    m[0][1] /= -determinant;
    m[1][0] /= -determinant;
    m[1][1] = m_00 / determinant;
}

/* The filter's gain; `model` is the zero-order hold of the manipulator alone, A the whole model. */
static bool kalman(const Weights *of, const Matrix *model, const Matrix *A, double fade,
                   double gain[N][AXES])
{
    const double measurement = squared(of->angle_noise) + squared(2.0 * PI / 65536.0) / 12.0;
    Matrix G = {{{0.0}}}, noise = {{{0.0}}}, P;
    for (int i = 0; i < AXES; i++) {
        G.of[Q_M + i][Q_M + i] = 1.0 / measurement;
        for (int row = 0; row < JOINTS; row++) {
            noise.of[row][i] = model->of[row][JOINTS + i] * of->motor_noise[i];
            noise.of[row][AXES + i] = model->of[row][JOINTS + AXES + i] * of->arm_noise;
        }
        noise.of[D + i][4 + i] = of->drift[i];
        noise.of[F + i][6 + i] = of->push * sqrt(1.0 - fade * fade);
    }
    const Matrix one = identity();
    if (!riccati(transposed(A), G, congruent(&noise, &one), &P)) return false;
    double innovation[AXES][AXES];
    for (int i = 0; i < AXES; i++)
        for (int j = 0; j < AXES; j++)
            innovation[i][j] = P.of[Q_M + i][Q_M + j] + (i == j ? measurement : 0.0);
    invert(innovation);
    const Matrix AP = product(A, &P);
    for (int row = 0; row < N; row++)
        for (int i = 0; i < AXES; i++)
            gain[row][i] = AP.of[row][Q_M] * innovation[0][i] + AP.of[row][Q_M + 1] * innovation[1][i];
    return true;
}

/* The feedback's gain and what the TCP error [m] is of the state, rows of `gain` and `tool`. */
static bool feedback(const Weights *of, const Pose *at, Matrix A, double gain[AXES][N],
                     double tool[AXES][N])
{
    const double q_12 = at->q_a[0] + at->q_a[1];
    const double elbow_x = -L[1] * elementary_sin(q_12), elbow_z = -L[1] * elementary_cos(q_12);
    tool[0][0] = L[0] * elementary_cos(at->q_a[0]) + elbow_x;
    tool[0][1] = elbow_x;
    tool[1][0] = -L[0] * elementary_sin(at->q_a[0]) + elbow_z;
    tool[1][1] = elbow_z;
    Matrix rows = {{{0.0}}}, B = {{{0.0}}}, scaled = {{{0.0}}}, X;
    for (int i = 0; i < AXES; i++) {
        for (int j = 0; j < AXES; j++) {
            rows.of[Q_A + j][i] = 1e3 * tool[i][j]; /* [mm] */
            rows.of[W_A + j][AXES + i] = of->velocity * 1e3 * tool[i][j];
        }
        rows.of[Q_M + i][4 + i] = of->motor_angle;
        for (int row = 0; row < JOINTS; row++) {
            B.of[row][i] = A.of[row][D + i];
            scaled.of[row][i] = B.of[row][i] / of->effort[i];
        }
        for (int j = 0; j < N; j++) /* the random walk is left out: without rows and columns it stays zero */
            A.of[j][D + i] = A.of[D + i][j] = 0.0;
    }
    const Matrix one = identity();
    if (!riccati(A, congruent(&scaled, &one), congruent(&rows, &one), &X)) return false;
    const Matrix B_T = transposed(&B), XA = product(&X, &A);
    const Matrix cost = congruent(&B_T, &X), right = product(&B_T, &XA);
    double left[AXES][AXES];
    for (int i = 0; i < AXES; i++)
        for (int j = 0; j < AXES; j++)
            left[i][j] = cost.of[i][j] + (i == j ? squared(of->effort[i]) : 0.0);
    invert(left);
    for (int i = 0; i < AXES; i++) {
        for (int j = 0; j < N; j++)
            gain[i][j] = left[i][0] * right.of[0][j] + left[i][1] * right.of[1][j];
        gain[i][D + i] = 1.0;
    }
    return true;
}

static bool refuse_design(char message[MODEL_MESSAGE_SIZE])
{
    snprintf(message, MODEL_MESSAGE_SIZE,
             "the Riccati equation has no stabilizing solution that the doubling algorithm could find");
    return false;
}

bool design(const Weights *of, const double q_m_ref[AXES], const double u_m0[AXES], double T_s, Law *law,
            char message[MODEL_MESSAGE_SIZE])
{
    const Pose at = pose(q_m_ref, u_m0);
    const Matrix zero = {{{0.0}}}, slope = linearize(of, &at);
    Matrix model;
    if (!exponential(sum(T_s, &slope, &zero), &model)) return refuse_design(message);
    const double fade = elementary_exp(-T_s / of->push_time);
    /* The inputs of the joints become the disturbances' states. */
    Matrix A = model;
    for (int i = 0; i < AXES; i++)
        A.of[F + i][F + i] = fade;
    double correction[N][AXES], gain[AXES][N] = {{0.0}}, tool[AXES][N] = {{0.0}};
    if (!kalman(of, &model, &A, fade, correction)) return refuse_design(message);
    if (!feedback(of, &at, A, gain, tool)) return refuse_design(message);
    *law = (Law){{{0.0}}};
    for (int row = 0; row < N; row++) {
        for (int j = 0; j < N; j++)
            law->columns[j][row] = A.of[row][j];
        for (int i = 0; i < AXES; i++) {
            law->columns[Q_M + i][row] -= correction[row][i];
            law->columns[U + i][row] = row < JOINTS ? model.of[row][JOINTS + i] : 0.0;
            law->columns[E + i][row] = correction[row][i];
        }
    }
    for (int i = 0; i < AXES; i++)
        for (int row = 0; row < N; row++)
            for (int j = 0; j < LAW; j++) {
                law->columns[j][U + i] -= gain[i][row] * law->columns[j][row];
                law->columns[j][E + i] += tool[i][row] * law->columns[j][row];
            }
    return true;
}
