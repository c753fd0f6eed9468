// Many uncertain systems in one pose: Figures 11 and 12.

/** The lines of all systems: those assumed and the worst of all stand out, the others share a colour and a name. */
function spreadLines(all, peakOf) {
  const worst = all.reduce((best, recording) => (peakOf(recording) > peakOf(best) ? recording : best));
  const assumed = (recording) => !recording.system.startsWith("random");
  const others = all.filter((recording) => !assumed(recording) && recording !== worst);
  const line = (recording, look) => ({ t: curve(recording).t, y: curve(recording).error, ...look });
  const outstanding = all.filter((recording) => !others.includes(recording)).map((recording) =>
    line(recording, {
      name: recording.system + (recording === worst ? " (worst)" : ""),
      ...(assumed(recording) ? { colour: colour("one"), width: 2.2, z: 5 } : { colour: colour("two"), width: 1.6, z: 4 }),
    }));
  return [...outstanding, ...others.map((recording) => line(recording, { name: `${others.length} others`, colour: colour("soft"), opacity: 0.4, width: 1, quiet: true }))];
}

function drawSpread() {
  const all = data.spread || [];
  if (!all.length) return;
  const pose = all[0].q_a.map(degrees).join(" / ");
  const dueToForce = (recording) => peak(curve(recording), recording.window[0], Infinity)[0];
  const dueToChirp = (recording) => peak(curve(recording), recording.chirp[0], recording.window[0])[0];
  const told = (peaks, target, cause) => {
    const values = peaks.filter((value) => value !== null);
    const missed = values.length < peaks.length ? [`${peaks.length - values.length} ended before ${cause}`] : [];
    const known = `largest errors from ${figures(Math.min(...values))} to ${figures(Math.max(...values))} mm, ${values.filter((value) => value > target).length} of ${values.length} above the target of ${figures(target)} mm`;
    return [...(values.length ? [known] : []), ...missed].join("; ");
  };

  const longest = all.reduce((best, recording) => (recording.time > best.time ? recording : best));
  const [begin] = longest.window;
  const force = criterion("B5").target * 1e3;
  const chirp = criterion("B7").target * 1e3;
  const look = { ...TCP_ERROR, targets: errorTargets(longest) };
  overTime("spread-force", {
    ...look,
    lines: spreadLines(all, dueToForce),
    spans: [{ name: "force", from: begin, to: longest.window[1] }],
    from: begin - 0.2,
    to: longest.time,
    text: `${all.length} uncertain systems with their disturbances at ${pose} (Figure 11): ${told(all.map(dueToForce), force, "the force")}.`,
  });
  overTime("spread-chirp", {
    ...look,
    lines: spreadLines(all, dueToChirp),
    from: 0,
    to: begin - 0.5,
    text: `The same systems under the motor torque disturbance (Figure 12): ${told(all.map(dueToChirp), chirp, "it")}. Blue: the system assumed to be the worst; orange, where it is another one: the worst of all.`,
  });
}
