// Several simulations over each other: TCP error and torques, zoomed together.

const HUES = ["one", "two", "three", "four", "five"];

const nameOf = (recording) => recording.roles.map(roleText).join("; ");

/** What is drawn of each recording: `pick` gives times and values of its signals. */
const overlaid = (pick) => recordings.map((recording, index) => {
  const [t, y] = pick(signals(recording));
  return { name: nameOf(recording), t, y, colour: colour(HUES[index % HUES.length]), dash: index < HUES.length ? "solid" : "dashed" };
});

function drawOverlay() {
  const until = Math.max(...recordings.map((recording) => recording.time));
  const most = recordings.map((recording) => `${nameOf(recording)}: at most ${figures(peak(signals(recording), 0, Infinity)[0])} mm`);
  const made = [overTime("overlay-error", {
    ...TCP_ERROR, from: 0, to: until, lines: overlaid(({ t, error }) => [t, error]),
    targets: recordings.every(pulsed) ? errorTargets(recordings[0]) : [],
    text: `${most.join(". ")}. Wheel with Ctrl, slider or a box zoom all charts; a click on a name hides its line.`,
  })];
  [1, 2].forEach((axis) => {
    const limit = data.rules.torque_limit[axis - 1];
    made.push(overTime(`overlay-torque-${axis}`, {
      unit: "Nm", label: "Motor torque", from: 0, to: until, lines: overlaid(({ torque }) => [torque[0], torque[axis]]),
      text: `Torque sent to the drive of axis ${axis}, which is limited to ${figures(limit)} Nm; gravity included.`,
    }));
  });
  echarts.connect(made);
}

view("case", drawCase);
view("motion", drawMotion);
if (recordings.length > 1) view("overlay", drawOverlay);

linkRecordings();
