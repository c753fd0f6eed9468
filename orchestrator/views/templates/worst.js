// The worst case as far as a search found it: its path, what matters, and how far the controller holds.

const searched = data.criteria.filter((entry) => data.path.some((step) => entry.name in step.worst));
const HUE_OF = Object.fromEntries(searched.map((entry, index) => [entry.name, ["one", "two", "three"][index % 3]]));
const narrow = () => window.innerWidth < 640;

/** The stages of the search in order, as name and the whole cases it began and ended at; what has parts is one stage. */
function stages() {
  const found = [];
  let from = 0;
  for (const { stage, spent } of data.path) {
    const name = stage.split(/, \d| of /)[0];
    if (found.length && found[found.length - 1].name === name) found[found.length - 1].to = spent;
    else found.push({ name, from, to: spent });
    from = spent;
  }
  return found;
}

function drawPathOfSearch() {
  const parts = stages();
  const end = data.path[data.path.length - 1].spent;
  const ratio = ({ name, target }, { worst }) => (worst[name] === null || worst[name] === undefined ? null : worst[name] / target);
  const room = $("#path-of-search").clientWidth - 80;
  const areas = parts.map((part, index) => ({ ...part, label: (room * (part.to - part.from)) / end < 14 ? "" : String(index + 1) }));
  const target = data.rules.cost.target;
  const largest = Math.max(1, ...searched.flatMap((entry) => data.path.map((step) => ratio(entry, step) || 0)), ...data.path.map(({ cost }) => (cost || 0) / target));
  const last = (entry) => `${entry.name} ${figures(entry.worst_case.value === null ? null : entry.worst_case.value * entry.factor)} ${entry.shown}`;
  chart("path-of-search", {
    legend: legend({ icon: "roundRect", data: ["V", ...searched.map((entry) => entry.name)] }),
    toolbox: toolbox(false),
    tooltip: tooltip({ trigger: "axis", axisPointer: { label: { formatter: ({ value }) => `${figures(value)} whole cases` } }, valueFormatter: (value) => `${figures(value)} times its target` }),
    grid: { left: 56, right: 24, top: 66, bottom: 48 },
    xAxis: axis("Budget spent [whole cases]", { min: 0, max: end, axisLabel: { color: colour("soft"), hideOverlap: true, showMaxLabel: false } }),
    yAxis: axis("Found / target", { nameGap: 36, min: 0, max: Number((1.2 * largest).toPrecision(2)), axisLabel: { color: colour("soft"), showMaxLabel: false } }),
    series: [{
      type: "line",
      name: "V",
      symbolSize: 7,
      lineStyle: { width: 3, color: colour("ink") },
      itemStyle: { color: colour("ink") },
      data: data.path.map(({ spent, cost }) => [spent, cost === null ? null : cost / target]),
    }, ...searched.map((entry, index) => ({
      type: "line",
      step: "end",
      name: entry.name,
      symbolSize: 5,
      itemStyle: { color: colour(HUE_OF[entry.name]) },
      data: data.path.map((step) => [step.spent, ratio(entry, step)]),
      ...(index ? {} : {
        markLine: { silent: true, symbol: "none", data: [level(1, "target")] },
        markArea: {
          silent: true,
          label: { color: colour("soft"), position: "insideTop" },
          data: areas.map((part, place) => [{ xAxis: part.from, name: part.label, itemStyle: { color: place % 2 ? "transparent" : colour("area") } }, { xAxis: part.to }]),
        },
      }),
    }))],
  }, `V of what was found so far, and the largest value of each criterion at any pose, by their targets: lower bounds, which a longer search may exceed. Stages: ${parts.map((part, index) => `${index + 1} ${part.name} (${figures(part.to - part.from)})`).join(", ")}; in brackets, whole cases. Found at last: V ${figures(data.path[data.path.length - 1].cost)}, ${searched.map(last).join(", ")}.`);
}

const SIGNS = { 1: "+", "-1": "−", 0: "nominal" };
const unbroken = (words) => words.replace(/ (axis \d)/, (_, axis) => ` ${axis.replace(" ", "\u00a0")}`);

function drawEffects() {
  const known = searched.filter((entry) => data.effects.some((effect) => effect.criterion === entry.name));
  if (!known.length) {
    $("#effects-chart-text").textContent = "No criterion was searched for.";
    return;
  }
  const { name, factor, shown } = criterion(options("effect-of", known.map((entry) => [entry.name, `${entry.name}, ${entry.title.toLowerCase()}`]), drawEffects).value);
  drawEnds(name);
  const all = data.effects.filter((effect) => effect.criterion === name);
  const rows = all.filter((effect) => effect.change !== null).map((effect) => ({ ...effect, part: -effect.change * factor })).sort((a, b) => b.part - a.part);
  const lost = all.length - rows.length;
  $("#effects-chart").style.height = `${72 + (narrow() ? 48 : 26) * rows.length}px`;
  bars("effects-chart", {
    names: rows.map((effect) => `${effect.parameter} ${unbroken(effect.words)}\u00a0${SIGNS[effect.sign] || figures(effect.sign)}`),
    series: [{
      name: `${name} falls by`, hue: "accent", label: barLabels(),
      values: rows.map(({ part }) => ({ value: part, itemStyle: { color: colour(part < 0 ? "soft" : "accent") } })),
    }],
    label: `What this end adds to ${name} [${shown}]`,
    grid: { left: 12, containLabel: true, right: 56 },
    labels: { width: narrow() ? 152 : 380, overflow: "break", lineHeight: 14 },
    text: `By how much the worst ${name} falls if one parameter alone goes to its other end: + and − are the ends at which it stands in the worst arm. Where the bar points to the left, the other end is worse.${lost ? ` For ${lost} parameters there is no value.` : ""}`,
  });
}

/** At which end each parameter stands in the worst arm of a criterion, by configuration. */
function drawEnds(name) {
  const poses = new Map(data.configurations.map((entry) => [entry.index, entry]));
  const known = data.peaks.filter((peak) => peak.criterion === name && poses.has(peak.configuration))
    .map((peak) => ({ ...peak, pose: poses.get(peak.configuration) }))
    .sort((a, b) => a.pose.q_a2 - b.pose.q_a2 || a.pose.q_a1 - b.pose.q_a1);
  if (!known.length) {
    $("#ends").replaceChildren();
    return;
  }
  const { factor, shown } = criterion(name);
  const cell = (deviation, words) => {
    const channels = blended(PUOR, (deviation + 1) / 2);
    const found = element("td", { title: words }, SIGNS[deviation] === "nominal" || deviation === 0 ? "0" : SIGNS[deviation] || figures(deviation));
    found.style.background = `rgb(${channels})`;
    found.style.color = readable(channels);
    return found;
  };
  const head = (words, values) => element("tr", {}, element("th", { scope: "row" }, words), ...values.map((value) => element("th", { scope: "col" }, value)));
  const rows = Object.keys(known[0].deviations).map((parameter) =>
    element("tr", {}, element("th", { scope: "row" }, parameter), ...known.map((peak) =>
      cell(peak.deviations[parameter], `${parameter} at q_a1 ${degrees(peak.pose.q_a1)}, q_a2 ${degrees(peak.pose.q_a2)}: ${figures(peak.deviations[parameter])} half-widths`))));
  $("#ends").replaceChildren(
    element("h2", {}, "The worst arm by pose"),
    element("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "The worst arm by pose" }, element("table", { class: "ends" },
      element("thead", {}, head("q_a2", known.map((peak) => degrees(peak.pose.q_a2))), head("q_a1", known.map((peak) => degrees(peak.pose.q_a1))), head(`${name} [${shown}]`, known.map((peak) => (peak.value === null ? "-" : figures(peak.value * factor))))),
      element("tbody", {}, ...rows))),
    element("p", { class: "caption" }, `At which end of its range each parameter stands in the worst arm found for ${name} at each configuration: + the upper end (orange), − the lower one (purple), 0 nominal.`));
}

function drawConfigurations() {
  const rows = data.configurations;
  $("#configurations-chart").style.height = `${72 + 34 * rows.length}px`;
  const more = rows.filter((entry) => entry.found !== null && entry.protocol !== null && entry.found > entry.protocol);
  const known = rows.filter((entry) => entry.found !== null);
  const worst = known.reduce((best, entry) => (best && best.found >= entry.found ? best : entry), null);
  const pose = (entry) => `${degrees(entry.q_a1)} / ${degrees(entry.q_a2)}`;
  const target = data.rules.cost.target;
  bars("configurations-chart", {
    names: rows.map(pose),
    series: [
      { name: "found", hue: "accent", values: rows.map((entry) => entry.found), label: barLabels(),
        markLine: { silent: true, symbol: "none", data: [{ xAxis: target, ...marked("target", "limit", "start") }] } },
      { name: "of the list", hue: "soft", values: rows.map((entry) => entry.protocol), itemStyle: { color: colour("soft"), opacity: 0.5 } },
    ],
    label: "V_k", grid: { left: 96, top: 48 },
    text: worst ? `V_k of eq. (14) by configuration (q_a1 / q_a2): of the list, and with all that was found there. The largest is ${figures(worst.found)} at ${pose(worst)}; the search found more than the list at ${more.length} of ${rows.length}.` : "No configuration has a value.",
  });
}

/** The rows of a margin, as [name, from, to, whether it is found, limit]: a thick line from one value to the other. */
function marginRows() {
  const { margins, radius } = data;
  const row = (name, entry, factor = 1) => ({ name, to: (entry.value ?? entry.limit) * factor, open: entry.value === null });
  const gains = [1, 2].filter((axis) => margins[`gain_${axis}`]).map((axis) => {
    const down = margins[`gain_${axis}_down`];
    return { ...row(`axis ${axis}`, margins[`gain_${axis}`]), from: down.value ?? down.limit, low: down.value !== null };
  });
  const delays = [1, 2].filter((axis) => margins[`delay_${axis}`]).map((axis) => ({ ...row(`axis ${axis}`, margins[`delay_${axis}`], 1e3), from: 0 }));
  const radii = radius ? [["V", radius.cost], ["A1 to A3", radius.stability]].map(([name, value]) => ({ ...row(name, { value, limit: radius.limit }), from: 0 })) : [];
  return [gains, delays, radii];
}

function drawMargins() {
  if (!$("#margins-chart")) return;
  const asked = (part) => Math.max(...data.rules.tests.map(part));
  const [gains, delays, radii] = marginRows();
  const parts = [
    { rows: gains, name: "Factor of the loop gain", needed: asked((test) => test.gain), words: "A1", type: "log", min: 0.4 * Math.min(0.5, ...gains.map((row) => row.from)) },
    { rows: delays, name: "Additional delay [ms]", needed: asked((test) => test.delay) * 1e3, words: "A2", min: 0 },
    { rows: radii, name: "Radius: factor on the tolerances of Table 1", needed: 1, words: "Table 1", min: 0 },
  ].filter((part) => part.rows.length).map((part) => ({ ...part, max: 1.15 * Math.max(part.needed, ...part.rows.map((row) => row.to)) }));
  const tall = 160;
  $("#margins-chart").style.height = `${tall * parts.length + 16}px`;
  const place = (index) => ({ gridIndex: index });
  const room = $("#margins-chart").clientWidth - 124;
  const at = (part, value) => (part.type === "log" ? Math.log(value) : value);
  /** Whether a value beside the end of its bar would stand on the line of what is needed. */
  const crowded = (part, row) => {
    const space = (room * (at(part, part.needed) - at(part, row.to))) / (at(part, part.max) - at(part, part.min));
    return space > 0 && space < 52;
  };
  const told = ({ to, open }) => `${open ? "> " : ""}${figures(to)}`;
  chart("margins-chart", {
    grid: parts.map((part, index) => ({ left: 76, right: 48, top: tall * index + 28, height: tall - 90 })),
    xAxis: parts.map((part, index) => axis(part.name, {
      ...place(index), type: part.type || "value", min: part.min, max: part.max,
      axisLabel: { color: colour("soft"), hideOverlap: true, showMinLabel: false, showMaxLabel: false, formatter: figures },
    })),
    yAxis: parts.map((part, index) => axis("", { ...place(index), type: "category", inverse: true, data: part.rows.map((row) => row.name), axisLabel: { color: colour("ink"), interval: 0 }, splitLine: { show: false } })),
    series: parts.flatMap((part, index) => part.rows.map((row, number) => {
      const hue = colour(!row.open && row.to <= part.needed ? "bad-fill" : "good-fill");
      return {
        type: "line", name: `${part.name}, ${row.name}`, xAxisIndex: index, yAxisIndex: index, silent: true, symbol: "rect", symbolSize: 1,
        data: [{ value: [row.from, row.name], label: { show: Boolean(row.low), position: "left" } }, { value: [row.to, row.name], label: { show: true, position: crowded(part, row) ? "left" : "right" } }],
        label: { color: colour("ink"), distance: 8, formatter: ({ dataIndex }) => (dataIndex ? told(row) : figures(row.from)), ...halo() },
        itemStyle: { color: hue }, lineStyle: { color: hue, width: 16, cap: "butt" },
        ...(number ? {} : { markLine: { silent: true, symbol: "none", data: [{ xAxis: part.needed, ...marked(`${part.words}: ${figures(part.needed)}`, "limit", "start") }] } }),
      };
    })),
  }, parts.map((part) => `${part.name}: ${part.rows.map((row) => `${row.name} ${row.low ? `${figures(row.from)} to ` : ""}${told(row)}`).join(", ")} (${part.words} asks for ${figures(part.needed)})`).join(". ") + ". A bar ends where a member of the uncertainty description was found to fail; orange: not beyond what is asked for.");
}

view("search", drawPathOfSearch);
view("effects", drawEffects);
view("case", drawCase);
view("motion", drawMotion);
view("configurations", drawConfigurations);
view("margins", drawMargins);
linkRecordings();
