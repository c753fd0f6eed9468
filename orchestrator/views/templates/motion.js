// A recorded case replayed: the arm with its deviations magnified, torques beside it.

let player = null;

/** The values of `columns` at time `at`, linear between the recorded rows. */
function interpolated(t, columns, at) {
  let [low, high] = [0, t.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (t[middle] <= at) low = middle;
    else high = middle;
  }
  const share = high === low ? 0 : Math.min(Math.max((at - t[low]) / (t[high] - t[low]), 0), 1);
  return columns.map((column) => column[low] + share * (column[high] - column[low]));
}

/** 1, 2 or 5 times a power of ten, at or below `value`. */
function roundNumber(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [5, 2, 1].find((digit) => digit * power <= value * 1.0001);
}

function drawMotion() {
  if (!recordings.length) return;
  if (player) player.stop();
  player = motionPlayer(recordings[current]);
}

function motionPlayer(recording) {
  const found = signals(recording);
  const [q_a1, q_a2] = recording.q_a;
  const home = joints(q_a1, q_a2).tcp;
  const { svg, world } = stage("The arm in motion; the figures stand below");
  const circles = [["limit", criterion("B5").target], ["three", data.rules.settling_error]].map(([hue, radius]) =>
    [radius, drawn("circle", { cx: home[0], cy: home[1], fill: "none", stroke: colour(hue), "stroke-width": 0.015, "stroke-dasharray": "0.05 0.04" })]);
  const resting = armDrawing(colour("soft"), 0.04, 0.45);
  const moving = armDrawing(colour("accent"));
  const trace = drawn("path", { fill: "none", stroke: colour("two"), "stroke-width": 0.012 });
  const arrow = drawn("path", { fill: "none", stroke: colour("limit"), "stroke-width": 0.04, "stroke-linecap": "round" });
  world.append(...circles.map((entry) => entry[1]), resting.group, moving.group, trace, arrow);
  resting.pose(q_a1, q_a2);
  $("#stage").replaceChildren(svg);

  const [largest, at] = peak(found, 0, Infinity);
  const scrub = $("#scrub");
  const magnify = $("#magnify");
  scrub.max = String(recording.time);
  scrub.value = String(at ?? 0);
  magnify.value = String(Math.log10(roundNumber(Math.min(1000, Math.max(1, 450 / Math.max(largest, 1e-3))))));
  let playing = null;

  const place = () => {
    const time = Number(scrub.value);
    const factor = Number((10 ** Number(magnify.value)).toPrecision(2));
    const [x, z, dq_1, dq_2] = interpolated(found.t, [found.x, found.z, found.dq_1, found.dq_2], time);
    const torques = found.torque.length && found.torque[0].length ? interpolated(found.torque[0], found.torque.slice(1), time) : [null, null];
    const tcp = moving.pose(q_a1 + factor * dq_1, q_a2 + factor * dq_2);
    circles.forEach(([radius, drawing]) => drawing.setAttribute("r", radius * factor));
    const path = [];
    for (let row = 0; row < found.t.length && found.t[row] <= time; row += 1) {
      if (found.t[row] > time - 1) path.push(joints(q_a1 + factor * found.dq_1[row], q_a2 + factor * found.dq_2[row]).tcp.map((value) => value.toFixed(4)));
    }
    trace.setAttribute("d", path.length > 1 ? `M${path.join("L")}` : "");
    const force = pulsed(recording) && time >= recording.window[0] && time < recording.window[1];
    arrow.setAttribute("d", force ? forceArrow(tcp, recording.force) : "");
    $("#magnify-text").textContent = `${factor} ×`;
    scrub.setAttribute("aria-valuetext", `${time.toFixed(2)} seconds, error ${figures(Math.hypot(x, z))} millimetres`);
    $("#motion-text").textContent =
      `${recording.id}. t = ${time.toFixed(3)} s, TCP error ${Math.hypot(x, z).toFixed(3)} mm, ` +
      `u_m1 ${figures(torques[0])} Nm, u_m2 ${figures(torques[1])} Nm, force ${force ? "on" : "off"}. ` +
      `Link angles' changes are magnified ${factor} ×, the circles (${figures(criterion("B5").target * 1e3)} and ${figures(data.rules.settling_error * 1e3)} mm) with them.`;
  };
  const stop = () => {
    cancelAnimationFrame(playing);
    playing = null;
    $("#play").textContent = "▶ Play";
  };
  const play = () => {
    let before = null;
    if (Number(scrub.value) >= recording.time) scrub.value = "0";
    const frame = (now) => {
      if (shownPanel() !== "motion") return stop();
      const elapsed = before === null ? 0 : (now - before) / 1000;
      before = now;
      scrub.value = String(Math.min(recording.time, Number(scrub.value) + elapsed * Number($("#speed").value)));
      place();
      if (Number(scrub.value) >= recording.time) return stop();
      playing = requestAnimationFrame(frame);
    };
    $("#play").textContent = "❚❚ Pause";
    playing = requestAnimationFrame(frame);
  };
  $("#jumps").replaceChildren(...windows(recording).map(([name, from]) =>
    element("button", { type: "button", onclick: () => ((scrub.value = String(from)), place()) }, name.replace("Whole", "Start").replace(/ \(.*/, ""))));
  $("#play").onclick = () => (playing === null ? play() : stop());
  scrub.oninput = place;
  magnify.oninput = place;
  place();
  return { stop };
}

/** An arrow of 0.5 m that points along the force and ends at the TCP. */
function forceArrow([x, z], [F_x, F_z]) {
  const size = Math.hypot(F_x, F_z);
  const [e_x, e_z] = [F_x / size, F_z / size];
  const at = (along, across) => `${x + along * e_x - across * e_z},${z + along * e_z + across * e_x}`;
  return `M${at(-0.55, 0)}L${at(-0.08, 0)}M${at(-0.2, 0.09)}L${at(-0.08, 0)}L${at(-0.2, -0.09)}`;
}
