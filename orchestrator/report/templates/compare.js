// Several runs under equal conditions: bars, difference maps, worst cases laid over each other.

const HUES = ["one", "two", "three", "four", "limit", "soft"];
const hue = (index) => colour(HUES[index % HUES.length]);
const runs = data.runs;

function options(id, entries, draw, chosen = 0) {
  const select = $(`#${id}`);
  if (select.options.length) return select;
  entries.forEach(([value, text]) => select.append(element("option", { value }, text)));
  select.selectedIndex = chosen;
  select.addEventListener("change", draw);
  return select;
}

function drawBars() {
  const ratio = (run, criterion) => (run.criteria[criterion.name].value === null ? null : run.criteria[criterion.name].value / criterion.target);
  const common = {
    legend: legend({ icon: "roundRect" }),
    toolbox: toolbox(false),
    tooltip: tooltip({ trigger: "axis", axisPointer: { type: "shadow" }, valueFormatter: figures }),
  };
  chart(
    "bars-chart",
    {
      ...common,
      grid: { left: 62, right: 24, top: 66, bottom: 40 },
      xAxis: axis("", { type: "category", data: data.criteria.map((criterion) => criterion.name) }),
      yAxis: axis("Value / target", { nameGap: 40 }),
      series: runs.map((run, index) => ({
        type: "bar", name: run.name, itemStyle: { color: hue(index) }, data: data.criteria.map((criterion) => ratio(run, criterion)),
        ...(index ? {} : { markLine: { silent: true, symbol: "none", data: [level(1, "target")] } }),
      })),
    },
    `B1 to B7 relative to their targets. ${runs.map((run) => `${run.name}: ${data.criteria.map((criterion) => figures(ratio(run, criterion))).join(", ")}`).join(". ")}.`
  );
  const names = runs.map((run) => run.name).reverse();
  chart(
    "stack-chart",
    {
      ...common,
      grid: { left: 12, right: 40, top: 66, bottom: 40, containLabel: true },
      xAxis: axis("V", {}),
      yAxis: axis("", { type: "category", data: names, axisLabel: { color: colour("ink"), width: 150, overflow: "truncate" } }),
      series: data.criteria.map((criterion, index) => ({
        type: "bar", stack: "V", name: criterion.name, itemStyle: { color: VIRIDIS[index + 1], borderColor: colour("card"), borderWidth: 1 },
        data: runs.map((run) => run.criteria[criterion.name].share).reverse(),
        ...(index ? {} : { markLine: { silent: true, symbol: "none", data: [{ xAxis: data.rules.cost.target, ...marked("target") }] } }),
      })),
    },
    "V of every run, made up of the shares of B1 to B7."
  );
}

function drawDifference() {
  if (runs.length < 2) return;
  const choices = runs.map((run, index) => [index, run.name]);
  const a = runs[options("minuend", choices, drawDifference, 1).value];
  const b = runs[options("subtrahend", choices, drawDifference, 0).value];
  const name = options("quantity", [["", "V_k"], ...data.criteria.map((entry, index) => [entry.name, `b${index + 1}: ${entry.title}`])], drawDifference).value;
  const value = (configuration) => (name ? configuration.relative[name] : configuration.cost);
  const difference = (configuration) => {
    const [first, second] = [a, b].map((run) => run.configurations.find((entry) => entry.index === configuration.index)).map((entry) => (entry ? value(entry) : null));
    return first === null || second === null ? null : first - second;
  };
  const largest = Math.max(...data.configurations.map((entry) => Math.abs(difference(entry) ?? 0)), 1e-9);
  const { svg, world } = stage("The arm in the pose of the chosen configuration");
  const arm = armDrawing(colour("accent"));
  world.append(arm.group);
  $("#arm").replaceChildren(svg);
  heatMap($("#heat"), {
    configurations: data.configurations,
    value: difference,
    range: [-largest, largest],
    colours: PUOR,
    name: `Difference of ${name || "V_k"}`,
    low: `${figures(-largest)}: ${a.name} is better`,
    high: `${figures(largest)}: ${b.name} is better`,
    chosen: (configuration) => {
      arm.pose(configuration.q_a1, configuration.q_a2);
      const told = [a, b].map((run) => `${run.name} ${figures(value(run.configurations.find((entry) => entry.index === configuration.index) || { relative: {} }))}`);
      $("#arm-text").textContent = `Configuration ${configuration.index}: q_a1 ${degrees(configuration.q_a1)}, q_a2 ${degrees(configuration.q_a2)}; ${name || "V_k"}: ${told.join(", ")}.`;
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
  const lines = shown.map(([run, index]) => {
    const [t, error] = run.worst[name].curve.map(unpack);
    return { name: run.name, t, y: error.map((metre) => 1e3 * metre), colour: hue(index) };
  });
  const { window: [begin, end], chirp } = shown[0][0].worst[name];
  const [from, to] = { B5: [begin - 0.2, end + 1], B6: [end - 0.1, end + 5], B7: [0, chirp[1] + 0.5] }[name];
  const criterion = data.criteria.find((entry) => entry.name === name);
  overTime("overlay-chart", {
    lines,
    unit: "mm",
    label: "TCP position error",
    levels: [level(name === "B6" ? data.rules.settling_error * 1e3 : criterion.target * 1e3, name === "B6" ? "settled" : "target")],
    spans: [{ name: "force", from: begin, to: end }],
    from,
    to,
    text: `TCP error of each run's own worst case of ${name}: ${shown.map(([run]) => `${run.name} in ${run.worst[name].id}`).join(", ")}.`,
  });
}

view("bars", drawBars);
view("difference", drawDifference);
view("overlay", drawOverlay);
startPage();
