package FlexibleManipulator "Controllers for the flexible manipulator benchmark"

  partial block Controller "The connectors of a controller: extend it, add equations, export it as an FMU"
    input Real q_m_ref[2](each unit = "rad") "Motor position reference, held constant";
    input Real q_m[2](each unit = "rad") "Measured motor position";
    output Real u_m[2](each unit = "N.m") "Motor torque command";
    parameter Real u_m0[2](each unit = "N.m") = {0, 0} "Torque of the initial steady state; the benchmark sets it";
    parameter Real T_s(unit = "s") = 0.25e-3 "Sample time";
  end Controller;

  block DiagonalPID "The benchmark's default controller, eq. (12)-(13)"
    extends Controller;
    parameter Real K_p[2](each unit = "N.m/rad") = {45, 15} "Proportional gain";
    parameter Real K_i[2](each unit = "N.m/(rad.s)") = {30, 10} "Integral gain";
    parameter Real K_d[2](each unit = "N.m.s/rad") = {1.5, 0.5} "Derivative gain";
    parameter Real z_p[2](each unit = "1") = {0.95, 0.95} "Pole of the derivative filter";
  protected
    discrete Real e[2](each unit = "rad", each start = 0, each fixed = true) "Error";
    discrete Real v[2](each unit = "rad/s", each start = 0, each fixed = true) "Filtered derivative of the error";
    discrete Real s[2](each unit = "N.m", start = u_m0, each fixed = true) "Integrator";
  equation
    when sample(0, T_s) then
      e = q_m_ref - q_m;
      v = z_p .* pre(v) + (ones(2) - z_p) .* (e - pre(e)) / T_s;
      s = pre(s) + K_i * T_s .* e;
      u_m = K_p .* e + K_d .* v + s;
    end when;
  end DiagonalPID;

  annotation(uses());
end FlexibleManipulator;
