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

/** Row and value of the largest entry. */
const largestOf = (values) => values.reduce((best, value, row) => (value > best[1] ? [row, value] : best), [0, 0]);

function drawMotion(place) {
  const [motion] = Object.values(data.motions);
  if (player) player.stop();
  player = motionPlayer(place, motion, motion.moved[chosen[motion.choice]]);
}

function motionPlayer(stand, { links, circles: radii, circleWords }, moved) {
  const [[t, x, z, dq_1, dq_2], torque] = [moved.motion, moved.torque].map((columns) => columns.map(column));
  const bent = (factor, changes) => moved.rest.map((angle, axis) => angle + factor * changes[axis]);
  const home = joints(links, moved.rest).tcp;
  const { svg, world, framed } = stage(links, "The arm in motion; the figures stand below");
  const circles = radii.map(([name, radius]) =>
    [radius, drawn("circle", { cx: home[0], cy: home[1], fill: "none", stroke: colour(name), "stroke-width": 0.015, "stroke-dasharray": "0.05 0.04" })]);
  const resting = armDrawing(links, colour("soft"), 0.04, 0.45);
  const moving = armDrawing(links, colour("accent"));
  const trace = drawn("path", { fill: "none", stroke: colour("two"), "stroke-width": 0.012 });
  const arrow = drawn("path", { fill: "none", stroke: colour("limit"), "stroke-width": 0.04, "stroke-linecap": "round" });
  framed.append(...circles.map((entry) => entry[1]));
  world.append(resting.group, moving.group, trace, arrow);
  resting.pose(moved.rest);
  stand.replaceChildren(svg);

  const [row, largest] = largestOf(x.map((value, index) => Math.hypot(value, z[index])));
  const scrub = $("#scrub");
  const magnify = $("#magnify");
  scrub.max = String(moved.end);
  scrub.value = String(t[row] ?? 0);
  magnify.value = String(Math.log10(roundNumber(Math.min(1000, Math.max(1, 450 / Math.max(largest, 1e-3))))));
  let playing = null;

  const place = () => {
    const time = Number(scrub.value);
    const factor = Number((10 ** Number(magnify.value)).toPrecision(2));
    const [right, up, ...changes] = interpolated(t, [x, z, dq_1, dq_2], time);
    const error = Math.hypot(right, up);
    const torques = torque[0].length ? interpolated(torque[0], torque.slice(1), time) : [null, null];
    const between = (axis) => (torques[axis] === (torques[axis + 2] ?? torques[axis]) ? "" : ` to ${figures(torques[axis + 2])}`);
    const tcp = moving.pose(bent(factor, changes));
    circles.forEach(([radius, drawing]) => drawing.setAttribute("r", radius * factor));
    const path = [];
    for (let at = 0; at < t.length && t[at] <= time; at += 1) {
      if (t[at] > time - 1) path.push(joints(links, bent(factor, [dq_1[at], dq_2[at]])).tcp.map((value) => value.toFixed(4)));
    }
    trace.setAttribute("d", path.length > 1 ? `M${path.join("L")}` : "");
    const pushes = moved.force ? [[moved.force, moved.window], ...(moved.more ?? [])] : [];
    const [force] = pushes.find(([, [begin, end]]) => time >= begin && time < end) ?? [];
    arrow.setAttribute("d", force ? forceArrow(tcp, force) : "");
    $("#magnify-text").textContent = `${factor} ×`;
    scrub.setAttribute("aria-valuetext", `${time.toFixed(2)} seconds, error ${figures(error)} millimetres`);
    $("#motion-text").textContent =
      `${moved.name}. t = ${time.toFixed(3)} s, TCP error ${error.toFixed(3)} mm, ` +
      `u_m1 ${figures(torques[0])}${between(0)} Nm, u_m2 ${figures(torques[1])}${between(1)} Nm, force ${force ? "on" : "off"}. ` +
      `Link angles' changes are magnified ${factor} ×, the circles (${circleWords}) with them.`;
  };
  const stop = () => {
    cancelAnimationFrame(playing);
    playing = null;
    $("#play").textContent = "▶ Play";
  };
  const play = () => {
    let before = null;
    if (Number(scrub.value) >= moved.end) scrub.value = "0";
    const frame = (now) => {
      if (!stand.offsetParent) return stop();
      const elapsed = before === null ? 0 : (now - before) / 1000;
      before = now;
      scrub.value = String(Math.min(moved.end, Number(scrub.value) + elapsed * Number($("#speed").value)));
      place();
      if (Number(scrub.value) >= moved.end) return stop();
      playing = requestAnimationFrame(frame);
    };
    $("#play").textContent = "❚❚ Pause";
    playing = requestAnimationFrame(frame);
  };
  $("#jumps").replaceChildren(...moved.places.map(([name, from]) =>
    element("button", { type: "button", onclick: () => ((scrub.value = String(from)), place()) }, name)));
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

painters.set("#stage", drawMotion);
