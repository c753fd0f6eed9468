// Several runs under equal conditions: bars, difference maps, worst cases laid over each other.

const HUES = ["one", "two", "three", "four", "five", "soft"];
const DASHES = ["solid", "dashed", "dotted"];
const FILLS = [
  { symbol: "none" },
  { dashArrayX: [1, 0], dashArrayY: [3, 4], rotation: Math.PI / 4 },
  { symbol: "circle", dashArrayX: [[6, 6], [0, 6, 6, 0]], dashArrayY: [6, 0] },
];

// Colours repeat after six runs, then with other dashes and fills.
const hue = (index) => colour(HUES[index % HUES.length]);
const turned = (looks, index) => looks[Math.floor(index / HUES.length) % looks.length];

// Runs stand in the order of the first leaderboard; by their rank there they are told apart where names are cut.
const runs = data.runs.map((run, row) => {
  const rank = $("#leaderboard tbody").rows[row].cells[0].textContent;
  return { ...run, label: `${rank === "-" ? `(${row + 1})` : `${rank}.`} ${run.name}` };
});

/** A legend of runs, with names as long as there is room for. */
function runLegend(id) {
  const most = Math.floor(($(`#${id}`).clientWidth - 100) / 8);
  return legend({ icon: "roundRect", data: runs.map((run) => run.label), formatter: (name) => (name.length > most ? `${name.slice(0, most - 1)}…` : name) });
}

function drawBars() {
  const ratio = (run, criterion) => (run.criteria[criterion.name].value === null ? null : run.criteria[criterion.name].value / criterion.target);
  const common = {
    toolbox: toolbox(false),
    tooltip: tooltip({ trigger: "axis", axisPointer: { type: "shadow" }, valueFormatter: figures }),
  };
  chart("bars-chart", {
    ...common,
    aria: { decal: { show: runs.length > HUES.length, decals: runs.map((_, index) => ({ color: colour("card"), ...turned(FILLS, index) })) } },
    legend: runLegend("bars-chart"),
    grid: { left: 62, right: 56, top: 66, bottom: 40 },
    xAxis: axis("", { type: "category", data: data.criteria.map((criterion) => criterion.name) }),
    yAxis: axis("Value / target", { nameGap: 40, max: reaching(1) }),
    series: runs.map((run, index) => ({
      type: "bar", name: run.label, itemStyle: { color: hue(index) }, data: data.criteria.map((criterion) => ratio(run, criterion)),
      ...(index ? {} : { markLine: { silent: true, symbol: "none", data: [level(1, "target", "limit", "end")] } }),
    })),
  }, `B1 to B7 relative to their targets. ${runs.map((run) => `${run.label}: ${data.criteria.map((criterion) => figures(ratio(run, criterion))).join(", ")}`).join(". ")}.`);
  const wide = Math.min(260, $("#stack-chart").clientWidth / 3);
  const heights = runs.map((run) => Math.max(36, 18 * Math.ceil((8 * run.label.length) / wide)));
  $("#stack-chart").style.height = `${144 + runs.length * Math.max(...heights)}px`;
  chart("stack-chart", {
    ...common,
    legend: legend({ icon: "roundRect" }),
    grid: { left: 12, right: 40, top: 80, bottom: 40, containLabel: true },
    xAxis: axis("V", { max: reaching(data.rules.cost.target) }),
    yAxis: axis("", { type: "category", data: runs.map((run) => run.label).reverse(), axisLabel: { color: colour("ink"), width: wide, lineHeight: 16, overflow: "break", interval: 0 } }),
    series: data.criteria.map((criterion, index) => ({
      type: "bar", stack: "V", name: criterion.name, itemStyle: { color: colour(`b${index + 1}`), borderColor: colour("card"), borderWidth: 0.5 },
      data: runs.map((run) => run.criteria[criterion.name].share).reverse(),
      ...(index ? {} : { markLine: { silent: true, symbol: "none", data: [{ xAxis: data.rules.cost.target, ...marked("target", "limit", "end") }] } }),
    })),
  }, "V of every run, made up of the shares of B1 to B7.");
}

const MARKS = {
  scorecard: { name: "scorecard", symbol: "circle", hue: "soft" },
  sampled: { name: "sampled: at most, for nearly all draws", symbol: "path://M10,0 L0,5 L10,10 Z", hue: "two" },
  found: { name: "found: at least, in the worst case", symbol: "path://M0,0 L10,5 L0,10 Z", hue: "one" },
};

/** What is known of V of each controller, on one axis. */
function drawBounds() {
  const rows = [...data.bounds].reverse();
  const wide = Math.min(260, $("#bounds-chart").clientWidth / 3);
  $("#bounds-chart").style.height = `${150 + 48 * rows.length}px`;
  const target = rows[0].target;
  chart("bounds-chart", {
    toolbox: toolbox(false),
    tooltip: tooltip({ trigger: "item", formatter: ({ data: point, seriesName }) => `${point.words || seriesName}: V ${figures(point.value[0])}` }),
    legend: legend(),
    grid: { left: 12, right: 40, top: 80, bottom: 40, containLabel: true },
    xAxis: axis("V", { min: 0, max: reaching(target) }),
    yAxis: axis("", { type: "category", data: rows.map((row) => row.name), axisLabel: { color: colour("ink"), width: wide, lineHeight: 16, overflow: "break", interval: 0 } }),
    series: Object.entries(MARKS).map(([kind, look], index) => ({
      type: "scatter", name: look.name, symbol: look.symbol, symbolSize: 14, itemStyle: { color: colour(look.hue) },
      data: rows.flatMap((row) => row.marks.filter((mark) => mark.kind === kind).map((mark) => ({ value: [mark.V, row.name], words: mark.words }))),
      ...(index ? {} : { markLine: { silent: true, symbol: "none", data: [{ xAxis: target, ...marked("target", "limit", "end") }] } }),
    })),
  }, `What is known of V. A scorecard is a sample or a list; what a search found bounds the worst case from below; a sample bounds what nearly all draws stay below. ${data.bounds.map((row) => `${row.name}: ${row.marks.map((mark) => `${figures(mark.V)} ${mark.words}`).join("; ")}`).join(". ")}.`);
}

/** The end of an axis that shows `value` even where all bars are shorter. */
const reaching = (value) => ({ max }) => (max < value ? Number((1.2 * value).toPrecision(2)) : null);

function drawDifference() {
  if (runs.length < 2) return;
  const choices = runs.map((run, index) => [index, run.label]);
  const a = runs[options("minuend", choices, drawDifference, 1).value];
  const b = runs[options("subtrahend", choices, drawDifference, 0).value];
  const name = options("quantity", [["", "V_k"], ...data.criteria.map((entry, index) => [entry.name, `b${index + 1}: ${entry.title}`])], drawDifference).value;
  const value = (configuration) => (name ? configuration.relative[name] : configuration.cost);
  const difference = (configuration) => {
    const [first, second] = [a, b].map((run) => run.configurations.find((entry) => entry.index === configuration.index)).map((entry) => (entry ? value(entry) : null));
    return first === null || second === null ? null : first - second;
  };
  const known = data.configurations.map(difference).filter((entry) => entry !== null);
  const largest = Math.max(0, ...known.map(Math.abs));
  workspaceMap({
    value: difference,
    range: [-(largest || 1), largest || 1],
    colours: PUOR,
    name: `Difference of ${name || "V_k"}`,
    ends: [`${figures(-largest)}: ${a.label} is better`, `${figures(largest)}: ${b.label} is better`],
    told: largest ? "" : known.length ? "no difference" : "no values",
    about: (configuration) => {
      const told = [a, b].map((run) => `${run.label} ${figures(value(run.configurations.find((entry) => entry.index === configuration.index) || { relative: {} }))}`);
      return `${name || "V_k"}: ${told.join(", ")}.`;
    },
  });
}

function drawOverlay() {
  const known = data.criteria.filter((criterion) => runs.some((run) => run.worst[criterion.name]));
  if (!known.length) {
    $("#overlay-chart-text").textContent = "These runs were made without trajectories.";
    return;
  }
  const name = options("which", known.map((criterion) => [criterion.name, `${criterion.name}, ${criterion.title.toLowerCase()}`]), drawOverlay).value;
  const shown = runs.map((run, index) => [run, index]).filter(([run]) => run.worst[name]);
  const line = ([run, index], t, y) => ({ name: run.label, t, y, colour: hue(index), dash: turned(DASHES, index) });
  const lines = shown.map((entry) => {
    const { t, error } = curve(entry[0].worst[name]);
    return line(entry, t, error);
  });
  const about = shown.map(([run]) => run.worst[name]).reduce((best, entry) => (entry.time > best.time ? entry : best));
  const { window: [begin, end], chirp } = about;
  const [from, to] = { B5: [begin - 0.2, end + 1], B6: [end, end + 5], B7: [0, chirp[1] + 0.5] }[name];
  const settled = lines.map((line) => peak({ t: line.t, error: line.y }, end + criterion("B6").target, Infinity)[0]);
  const charts = [overTime("overlay-chart", {
    ...TCP_ERROR, lines, from, to,
    targets: errorTargets(about),
    spans: [{ name: "force", from: begin, to: end }],
    top: name === "B6" ? settlingTop(Math.max(...settled)) : undefined,
    legend: runLegend("overlay-chart"),
    text: `TCP error of each run's own worst case of ${name}: ${shown.map(([run]) => `${run.label} in ${run.worst[name].id}`).join(", ")}.`,
  })];
  for (const axis of [1, 2]) {
    const limit = data.rules.torque_limit[axis - 1];
    const torques = shown.map((entry) => line(entry, ...[0, axis].map((column) => unpack(entry[0].worst[name].torque[column]))));
    const most = torques.map(({ name, y }) => `${name} ${figures(y.reduce((best, value) => Math.max(best, Math.abs(value)), 0))} Nm`);
    charts.push(overTime(`overlay-torque-${axis}`, {
      lines: torques, unit: "Nm", label: "Motor torque", from, to, bound: 1.08 * limit, legend: runLegend(`overlay-torque-${axis}`),
      levels: [limit, -limit].map((value) => level(value, "limit")),
      text: `Torque of axis ${axis} in the same cases, limited to ${figures(limit)} Nm; the largest: ${most.join(", ")}.`,
    }));
  }
  echarts.connect(charts);
  $("#overlay-cases").replaceChildren(...shown.map(([run]) => element("div", {}, `${run.label}: ${run.worst[name].id}`, commandLine(run.worst[name].id, run.worst[name].command))));
}

/** Points with error bars, those of a criterion beside each other. */
function drawSeeds() {
  const spreads = data.spreads.map((spread, index) => ({ ...spread, label: `${index + 1}. ${spread.name}` }));
  const names = ["V", ...new Set(spreads.flatMap((spread) => spread.points.map((point) => point.name)).filter((name) => name !== "V").sort())];
  const step = 0.7 / spreads.length;
  const place = (point, index) => names.indexOf(point.name) + step * (index - (spreads.length - 1) / 2);
  const words = (point) => `${point.name} ${figures(point.mean)} ± ${figures(point.deviation)}`;
  const target = marked("target", "limit", "end");
  const top = Math.max(1, ...spreads.flatMap((spread) => spread.points.map((point) => point.mean + point.deviation)));
  chart("seeds-chart", {
    toolbox: toolbox(false),
    tooltip: tooltip({ formatter: ({ seriesIndex, dataIndex }) => words(spreads[seriesIndex].points[dataIndex]) }),
    legend: legend({ data: spreads.map((spread) => spread.label) }),
    grid: { left: 62, right: 56, top: 66, bottom: 40 },
    xAxis: axis("", { min: -0.5, max: names.length - 0.5, interval: 0.5, splitLine: { show: false }, axisTick: { show: false }, axisLabel: { color: colour("soft"), formatter: (value) => names[value] ?? "" } }),
    yAxis: axis("Mean / target", { nameGap: 40, max: Math.ceil(2.1 * top) / 2 }),
    series: spreads.map((spread, index) => ({
      type: "scatter", name: spread.label, symbol: ["circle", "rect", "triangle", "diamond"][index % 4], symbolSize: 9, itemStyle: { color: hue(index) },
      data: spread.points.map((point) => [place(point, index), point.mean]),
      markLine: {
        silent: true, symbol: ["rect", "rect"], symbolSize: [9, 1.5], label: { show: false }, lineStyle: { color: hue(index), type: "solid", width: 1.5 },
        data: [
          ...spread.points.map((point) => [-1, 1].map((sign) => ({ coord: [place(point, index), point.mean + sign * point.deviation] }))),
          ...(index ? [] : [{ yAxis: 1, ...target, label: { ...target.label, show: true }, symbol: "none" }]),
        ],
      },
    })),
  }, `Mean ± standard deviation over the seeds, relative to the targets. ${spreads.map((spread) => `${spread.label}: ${spread.points.map(words).join(", ")}`).join(". ")}.`);
}

if (runs.length) {
  view("bars", drawBars);
  view("difference", drawDifference);
  view("overlay", drawOverlay);
}
if (data.spreads) view("seeds", drawSeeds);
if (data.bounds.length) view("bounds", drawBounds);
