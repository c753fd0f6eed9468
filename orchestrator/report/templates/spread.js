// Many uncertain systems in one pose: Figures 11 and 12.

/** Times [s] and TCP error [mm] of a system, unpacked once. */
function spreadSignals(recording) {
  if (!recording.unpacked) {
    const [t, error] = recording.curve.map(unpack);
    recording.unpacked = { t, error: error.map((value) => 1e3 * value) };
  }
  return recording.unpacked;
}

function drawSpread() {
  const all = data.spread || [];
  if (!all.length) return;
  const hues = ["one", "three", "four"].map(colour);
  const lines = all.map((recording, index) => {
    const assumed = !recording.system.startsWith("random");
    const look = assumed ? { colour: colour("two"), width: 2.4, z: 5 } : { colour: hues[index % hues.length], opacity: 0.65, width: 1 };
    return { name: recording.system, t: spreadSignals(recording).t, y: spreadSignals(recording).error, ...look };
  });
  const pose = all[0].q_a.map(degrees).join(" / ");
  const within = (part) => all.map((recording) => peak(spreadSignals(recording), ...part(recording))[0]);
  const told = (values, target) =>
    `${figures(Math.min(...values))} to ${figures(Math.max(...values))} mm, ${values.filter((value) => value > target).length} of ${values.length} above the target of ${figures(target)} mm`;

  const longest = all.reduce((best, recording) => (recording.time > best.time ? recording : best));
  const [begin] = longest.window;
  const force = criterion("B5").target * 1e3;
  const chirp = criterion("B7").target * 1e3;
  overTime("spread-force", {
    lines,
    unit: "mm",
    label: "TCP position error",
    targets: errorTargets(longest),
    spans: [{ name: "force", from: begin, to: longest.window[1] }],
    from: begin - 0.2,
    to: longest.time,
    text: `${all.length} uncertain systems with their disturbances at ${pose} (Figure 11): largest errors from ${told(within((recording) => [recording.window[0], Infinity]), force)}.`,
  });
  overTime("spread-chirp", {
    lines,
    unit: "mm",
    label: "TCP position error",
    targets: errorTargets(longest),
    from: 0,
    to: begin - 0.5,
    text: `The same systems under the motor torque disturbance (Figure 12): largest errors from ${told(within((recording) => [recording.chirp[0], recording.window[0]]), chirp)}. Thick: the assumed worst case.`,
  });
}
