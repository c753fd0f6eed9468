// One recorded case over time: TCP error, torques against their limits, path of the TCP in the circles.

const recordings = data.recordings || [];
let current = Math.max(0, recordings.findIndex((recording) => recording.roles.includes("B5")));

/** The columns of a recording, unpacked once: times [s], TCP offset and error [mm], changes of q_a [rad], torques [Nm]. */
function signals(recording) {
  if (!recording.unpacked) {
    const [t, x, z, dq_1, dq_2] = recording.motion.map(unpack);
    const mm = (column) => column.map((value) => 1e3 * value);
    const torque = (recording.torque || []).map(unpack);
    recording.unpacked = { t, x: mm(x), z: mm(z), error: t.map((_, row) => 1e3 * Math.hypot(x[row], z[row])), dq_1, dq_2, torque };
  }
  return recording.unpacked;
}

/** What a recording is shown for, in words. */
function roleText(role) {
  if (role.startsWith("simulation ")) return role.slice("simulation ".length);
  if (role === "example") return "example, nominal system (Figures 9 and 10)";
  const [name, part] = role.split(" ");
  if (part) return `worst of ${name}, ${name === "A3" ? part : `axis ${part}`}`;
  return `worst ${name}: ${criterion(name).title}`;
}

const poseText = (recording) => `${recording.q_a.map(degrees).join(" / ")}, ${recording.system}, ${recording.test}`;

const pulsed = (recording) => Math.hypot(...recording.force) > 0;

/** Sections of a case worth a look, as [name, from, to] [s], and the largest error shown [mm] where it is not all. */
function windows(recording) {
  const [begin, end] = recording.window;
  const whole = [["Whole", 0, recording.time]];
  if (!pulsed(recording)) return whole;
  const settled = end + criterion("B6").target;
  return [...whole, ["Chirp (Fig. 10)", recording.chirp[0], recording.chirp[1] + 0.5], ["Force (Fig. 9)", begin - 0.2, end + 1.5],
    ["Settling", end, settled + 1, settlingTop(peak(signals(recording), settled, Infinity)[0])], ["Last 3 s", recording.duration - 3, recording.duration]].filter((entry) => entry[2] <= recording.time + 1e-6);
}

function choose(index) {
  current = index;
  for (const select of document.querySelectorAll(".pick")) select.value = String(index);
  const { id, command } = recordings[index];
  for (const place of document.querySelectorAll(".repeat")) place.replaceChildren(...(command ? [commandLine(id, command)] : []));
}

function drawCase() {
  if (!recordings.length) return;
  const recording = recordings[current];
  const found = signals(recording);
  const sections = windows(recording);
  const wanted = recording.roles.includes("B7") ? "Chirp" : recording.roles.includes("B5") ? "Force" : recording.roles.includes("B6") ? "Settling" : "Whole";
  const [, from, to, top] = sections.find((entry) => entry[0].startsWith(wanted)) || sections[0];
  const ending = recording.status === "done" ? "" : ` Ended ${recording.status} at ${figures(recording.time)} s: ${recording.message}`;
  $("#case-text").textContent = `${recording.id}: ${recording.roles.map(roleText).join("; ")}.${ending}`;

  const error = drawError(recording, found, from, to, top);
  const torque = drawTorque(recording, found, from, to);
  echarts.connect([error, torque]);
  drawPath(recording, found);
  $("#windows").replaceChildren(...sections.map(([name, ...section]) =>
    element("button", { type: "button", onclick: () => zoomTo(error, ...section) }, name)));
}

function drawError(recording, found, from, to, top) {
  const [begin, end] = recording.window;
  const spans = pulsed(recording)
    ? [{ name: "chirp", from: recording.chirp[0], to: recording.chirp[1] }, { name: "force", from: begin, to: end }]
    : [];
  const [largest, at] = peak(found, 0, Infinity);
  const causes = pulsed(recording)
    ? [["the chirp", recording.chirp[0], begin], [`the force of ${figures(Math.hypot(...recording.force))} N`, begin, Infinity]]
        .map(([name, first, last]) => ({ name, most: peak(found, first, last)[0] }))
    : [{ name: "measurement noise alone", most: largest }];
  const parts = causes.filter((cause) => cause.most !== null).map((cause) => `${figures(cause.most)} mm due to ${cause.name}`);
  const missed = causes.filter((cause) => cause.most === null).map((cause) => cause.name);
  const nominal = recording.beside ? [{ name: "nominal arm", t: curve(recording.beside).t, y: curve(recording.beside).error, colour: colour("two") }] : [];
  const beside = nominal.length ? ` The nominal arm in the same pose and test: at most ${figures(peak(curve(recording.beside), 0, Infinity)[0])} mm.` : "";
  return overTime("error-chart", {
    ...TCP_ERROR, spans, from, to, top,
    lines: [{ name: recording.beside ? recording.system : "TCP error", t: found.t, y: found.error, colour: colour("one"), z: 3 }, ...nominal],
    targets: pulsed(recording) ? errorTargets(recording) : [],
    text:
      `TCP error of ${poseText(recording)}: at most ${parts.join(", ") || `${figures(largest)} mm`}; the largest at ${figures(at)} s.` +
      `${missed.length ? ` The case ended at ${figures(recording.time)} s, before ${missed.join(" and ")}.` : ""}${beside} Wheel with Ctrl, slider or buttons zoom.`,
  });
}

function drawTorque(recording, found, from, to) {
  const [t, ...torques] = found.torque;
  const limits = data.rules.torque_limit;
  const most = torques.map((values) => values.reduce((best, value) => Math.max(best, Math.abs(value)), 0));
  const reached = limits.flatMap((limit, index) => [limit, -limit].map((value) => level(value, `limit ${index + 1}`, ["one", "two"][index])));
  return overTime("torque-chart", {
    lines: torques.map((y, index) => ({ name: `u_m${index + 1}`, t, y, colour: colour(["one", "two"][index]), width: 1 })),
    unit: "Nm", label: "Motor torque", levels: reached, bound: Math.max(...limits) * 1.08, from, to,
    text: `Torques sent to the drives: at most ${figures(most[0])} Nm of ${limits[0]} Nm on axis 1 and ${figures(most[1])} Nm of ${limits[1]} Nm on axis 2, gravity included.`,
  });
}

/** A closed circle as a line. */
const circle = (radius) => Array.from({ length: 121 }, (_, step) => [radius * Math.cos((step * Math.PI) / 60), radius * Math.sin((step * Math.PI) / 60)]);

function drawPath(recording, found) {
  const end = recording.window[1];
  const large = criterion("B5").target * 1e3;
  const small = data.rules.settling_error * 1e3;
  const due = end + criterion("B6").target;
  const first = pulsed(recording) ? recording.window[0] : 0;
  const rows = Array.from(found.t.keys());
  const part = (from, to) => rows.filter((row) => found.t[row] >= from && found.t[row] < to).map((row) => [found.x[row], found.z[row]]);
  const sets = pulsed(recording)
    ? [["force and settling", part(first, due), "one"], [`after ${figures(criterion("B6").target)} s of settling`, part(due, Infinity), "two"]]
    : [["TCP", part(0, Infinity), "one"]];
  const paths = sets.filter(([, points]) => points.length);
  const close = $("#path-scale").value === "small";
  const extent = Math.max(...found.error.filter((_, row) => found.t[row] >= first), large) * 1.1;
  const reach = close ? 2.5 * small : extent;
  const place = $("#path-chart");
  place.style.height = `${Math.min(480, place.clientWidth + 38)}px`; // the square of the path, and what stands around it
  const side = Math.min(place.clientWidth - 84, place.clientHeight - 122);
  const path = (name, points, hue, lineStyle) => ({ type: "line", name, data: points, showSymbol: false, itemStyle: { color: colour(hue) }, lineStyle });
  const zoom = { type: "inside", filterMode: "none", zoomOnMouseWheel: "ctrl" };
  const grid = { left: Math.max(66, (place.clientWidth - side) / 2), top: 66, width: side, height: side };
  const plane = { min: -reach, max: reach, axisLabel: { formatter: figures, color: colour("soft"), hideOverlap: true, showMinLabel: false, showMaxLabel: false } };
  chart("path-chart", {
    legend: legend({ icon: "roundRect" }),
    toolbox: toolbox(false),
    tooltip: tooltip({ trigger: "item", valueFormatter: (value) => (Array.isArray(value) ? value.map(figures).join(", ") : value) + " mm" }),
    grid,
    xAxis: axis("x offset [mm]", plane),
    yAxis: axis("z offset [mm]", { ...plane, nameGap: 46 }),
    dataZoom: [{ ...zoom, xAxisIndex: 0 }, { ...zoom, yAxisIndex: 0 }],
    series: [
      ...paths.map(([name, points, hue]) => path(name, points, hue, { width: 1.2 })),
      path(`${figures(large)} mm`, circle(large), "limit", { type: "dashed" }),
      path(`${figures(small)} mm`, circle(small), "three", { type: "dashed" }),
    ],
  }, pulsed(recording)
    ? `Path of the TCP from the beginning of the force (Figure 8): wanted always inside the large circle, and ${figures(criterion("B6").target)} s after the force inside the small one; ${pathVerdict(recording, peak(found, first, Infinity)[0], peak(found, due, Infinity)[0])}`
    : "Path of the TCP.");
}

/** What became of a case whose largest errors [mm] are `forced` from the force on and `settled` from when it is to rest. */
function pathVerdict(recording, forced, settled) {
  const ended = `ended at ${figures(recording.time)} s, before`;
  if (forced === null) return `the case ${ended} the force.`;
  const large = forced <= criterion("B5").target * 1e3 ? "it stays inside the large one" : "it leaves the large one";
  if (settled === null) return `${large} and ${ended} it was to be inside the small one.`;
  return `${large} and ${settled < data.rules.settling_error * 1e3 ? "is" : "is not"} inside the small one in time.`;
}

/** Fill the selects of cases, and let every button that names a recording show it. */
function linkRecordings() {
  for (const select of document.querySelectorAll(".pick")) {
    recordings.forEach((recording, index) =>
      select.append(element("option", { value: index }, `${recording.roles.map(roleText).join("; ")} (${recording.id})`)));
    select.addEventListener("change", () => {
      choose(Number(select.value));
      show(select.closest('[role="tabpanel"]').id);
    });
  }
  if (recordings.length) choose(current);

  for (const button of document.querySelectorAll("[data-recording]")) {
    button.addEventListener("click", () => {
      choose(Number(button.dataset.recording));
      show("case");
      window.scrollTo(0, 0);
      $("#pick-case").focus();
    });
  }
  if ($("#path-scale")) $("#path-scale").addEventListener("change", drawCase);
}
