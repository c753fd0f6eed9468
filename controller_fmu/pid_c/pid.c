#include "pid.h"

PidState pid_sample(PidGains gains, PidState state, double e)
{
    return (PidState){
        .e = e,
        .v = gains.z_p * state.v + (1.0 - gains.z_p) * (e - state.e) / gains.T_s,
        .s = state.s + gains.K_i * gains.T_s * e,
    };
}

double pid_torque(PidGains gains, PidState state)
{
    return gains.K_p * state.e + gains.K_d * state.v + state.s;
}
