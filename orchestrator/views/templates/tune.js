// A tuning: how the search went, which parameters matter, and what a lower V costs in stability.

const { trials, judged } = data;
const added = judged.filter((entry) => entry.commands.length);
const best = data.best === null ? null : trials[data.best];

/** A candidate and its values in words, escaped. */
const told = (trial) => [
  `trial ${trial.number}: V = ${figures(trial.cost)}${trial.cut_short ? " and worse, cut short" : `, objective ${figures(trial.objective)}`}`,
  ...(trial.message ? [trial.message] : []),
  ...Object.entries(trial.values).map(([name, value]) => `${name} = ${figures(value)}`),
].map(echarts.format.encodeHTML).join("<br>");

/** Candidates as points of a series; `at` gives their place. */
const points = (name, hue, chosen, at, more = {}) => ({
  type: "scatter", name, symbolSize: 8, itemStyle: { color: colour(hue) },
  data: chosen.map((trial) => ({ value: at(trial), trial: trial.number })), ...more,
});

/** The candidates by what they came to; the best one stands out in a chart of them. */
const kinds = (at) => [
  points("cut short", "soft", trials.filter((trial) => trial.cut_short), at, { symbolSize: 6, itemStyle: { color: colour("soft"), opacity: 0.5 } }),
  points("A1–A3 fail", "bad-fill", trials.filter((trial) => !trial.cut_short && !trial.holds), at, { symbol: "triangle" }),
  points("A1–A3 hold", "one", trials.filter((trial) => !trial.cut_short && trial.holds), at),
  ...(best ? [points("best", "good-fill", [best], at, { symbol: "diamond", symbolSize: 18, z: 5 })] : []),
];

/** An entry of a legend for a line. */
const lined = (name) => ({ name, icon: "roundRect" });

const hint = () => tooltip({ trigger: "item", formatter: ({ data: point }) => (point && point.trial !== undefined ? told(trials[point.trial]) : "") });

const WORST_SHOWN = 3; // times the best value: what is worse is drawn there, else it would press the others together

/** An axis for positive values, and where a value stands on it. */
function bounded(name, values, more = {}) {
  const top = Math.min(1.05 * Math.max(...values), WORST_SHOWN * Math.min(...values));
  const round = { min: Number((0.95 * Math.min(...values)).toPrecision(2)), max: Math.ceil(top) };
  return { axis: axis(name, { nameGap: 44, ...round, axisLabel: { color: colour("soft"), showMinLabel: false, showMaxLabel: false }, ...more }), place: (value) => Math.min(value, round.max) };
}

const CLIPPED = `What is worse than ${WORST_SHOWN} times the best stands at the end of the axis.`;

function drawHistory() {
  const objective = bounded("Objective", [data.target, ...trials.map((trial) => trial.objective)]);
  let least = Infinity;
  const line = trials.map((trial) => {
    if (!trial.cut_short) least = Math.min(least, trial.objective);
    return [trial.number, Number.isFinite(least) ? objective.place(least) : null];
  });
  const series = kinds((trial) => [trial.number, objective.place(trial.objective)]);
  series[0].markLine = { silent: true, symbol: "none", data: [level(data.target, "target")] };
  chart("history-chart", {
    legend: legend({ data: [lined("best so far"), ...series.map(({ name }) => name)] }),
    toolbox: toolbox(true),
    tooltip: hint(),
    grid: { left: 64, right: 24, top: 84, bottom: 48 },
    xAxis: axis("Trial", { min: 0, max: trials.length, minInterval: 1 }),
    yAxis: objective.axis,
    series: [
      {
        type: "line", name: "best so far", step: "end", showSymbol: false, data: line, itemStyle: { color: colour("accent") }, lineStyle: { width: 2 },
        markLine: { silent: true, symbol: "none", data: added.map((entry, index) => ({ xAxis: entry.after, name: `+${entry.commands.length}`, lineStyle: { color: colour("two"), type: "dotted", width: 1.5 }, label: { formatter: `+${entry.commands.length}`, color: colour("two"), position: "end" } })) },
      },
      ...series,
    ],
  }, `The objective: V of the protocol ${data.objective}, and more where A1 to A3 fail. Of candidates that were cut short it is V alone. ${added.length ? `Dotted: where cases that failed in the whole protocol were added (+ their number), ${added.map((entry) => `after ${entry.after} trials`).join(", ")}; the best candidates were tried again with them, so that a point is what its candidate came to at last.` : "No case was added."} ${CLIPPED}`);
}

function drawImportance() {
  const rows = Object.entries(data.importance).sort(([, a], [, b]) => b - a);
  const place = $("#importance-chart");
  place.style.height = rows.length ? `${72 + 32 * rows.length}px` : "0";
  if (!rows.length) {
    $("#importance-chart-text").textContent = "Of one parameter, or of candidates that all came to the same, there is no importance.";
    return;
  }
  bars("importance-chart", {
    names: rows.map(([name]) => name),
    series: [{ name: "importance", hue: "accent", values: rows.map(([, share]) => share), label: barLabels() }],
    label: "Share in how the objective varies", grid: { left: 12, containLabel: true, right: 56 },
    text: "The share of each parameter in how the objective varies among the better candidates (PED-ANOVA).",
  });
}

function drawSlice() {
  const name = options("slice-of", Object.keys(data.vary).map((each) => [each, each]), drawSlice).value;
  const { low, high, log } = data.vary[name];
  const objective = bounded("Objective", trials.map((trial) => trial.objective));
  const ends = log ? { type: "log" } : {};
  chart("slice-chart", {
    legend: legend({ top: 2 }),
    tooltip: hint(),
    grid: { left: 64, right: 24, top: 44, bottom: 48 },
    xAxis: axis(name, { ...ends, min: low, max: high, axisLabel: { color: colour("soft"), hideOverlap: true, formatter: figures } }),
    yAxis: objective.axis,
    series: kinds((trial) => [trial.values[name], objective.place(trial.objective)]),
  }, `The candidates by ${name}, from one end of its range to the other. ${CLIPPED}`);
}

function drawTrade() {
  const known = trials.filter((trial) => trial.cost !== null && trial.cycle !== null && trial.cycle > 0);
  if (!known.length) {
    $("#trade-chart-text").textContent = "No candidate has both a cost and a limit cycle's amplitude.";
    return;
  }
  const cost = bounded("V in the objective", [data.target, ...known.map((trial) => trial.cost)], { nameGap: 30 });
  const at = (trial) => [cost.place(trial.cost), trial.cycle];
  const sorted = known.slice().sort((a, b) => a.cost - b.cost || a.cycle - b.cycle);
  const front = sorted.filter((trial, index) => sorted.slice(0, index).every((other) => other.cycle > trial.cycle));
  const shown = kinds(at).map((each) => ({ ...each, data: each.data.filter(({ trial }) => known.includes(trials[trial])) })).filter((each) => each.data.length);
  const cycles = [1, ...known.map((trial) => trial.cycle)].map(Math.log10);
  chart("trade-chart", {
    legend: legend({ data: [lined("Pareto front"), ...shown.map(({ name }) => name)] }),
    toolbox: toolbox(true),
    tooltip: hint(),
    grid: { left: 72, right: 24, top: 66, bottom: 48 },
    xAxis: cost.axis,
    yAxis: axis("Largest limit cycle / what A3 allows", { type: "log", min: 10 ** Math.floor(Math.min(...cycles)), max: 10 ** Math.ceil(Math.max(...cycles)), nameGap: 52, axisLabel: { color: colour("soft"), formatter: String } }),
    series: [
      {
        type: "line", name: "Pareto front", step: "end", showSymbol: false, data: front.map(at), itemStyle: { color: colour("accent") },
        markLine: { silent: true, symbol: "none", data: [level(1, "A3", "limit", "insideEndBottom"), { xAxis: data.target, ...marked("target", "limit", "end") }] },
      },
      ...shown,
    ],
  }, `V against the largest limit cycle relative to what A3 allows, of the ${known.length} candidates that have both. On the front, no other candidate is better in both.${best ? ` The best: V = ${figures(best.cost)}, ${figures(best.cycle)} times what A3 allows.` : ""} Above 1, A3 holds where the oscillation dies away. ${CLIPPED}`);
}

view("history", drawHistory);
view("parameters", () => { drawImportance(); drawSlice(); });
view("trade", drawTrade);
