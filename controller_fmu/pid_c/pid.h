/* The benchmark's PID law of one axis, eq. (13):
 *
 *     v_k = z_p v_{k-1} + (1 - z_p) (e_k - e_{k-1}) / T_s        filtered derivative [rad/s]
 *     s_k = s_{k-1} + K_i T_s e_k                                integrator [N.m]
 *     u_k = K_p e_k + K_d v_k + s_k                              torque command [N.m]
 *
 * Compile without contraction to fused multiply-add (-ffp-contract=off): then the torques are the same to the
 * last bit on all machines and in all languages.
 */
#ifndef PID_H
#define PID_H

typedef struct {
    double K_p; /* proportional gain [N.m/rad] */
    double K_i; /* integral gain [N.m/(rad.s)] */
    double K_d; /* derivative gain [N.m.s/rad] */
    double z_p; /* pole of the derivative filter [1], 0 <= z_p < 1 */
    double T_s; /* sample time [s], > 0 */
} PidGains;

/* What an axis remembers from its last sample; before the first one e = v = 0 and s = u_m0. */
typedef struct {
    double e; /* error q_m_ref - q_m [rad] */
    double v; /* filtered derivative of the error [rad/s] */
    double s; /* integrator [N.m] */
} PidState;

/* The state after a sample of the error e [rad]. */
PidState pid_sample(PidGains gains, PidState state, double e);

/* The torque command [N.m] that belongs to a state. */
double pid_torque(PidGains gains, PidState state);

#endif
