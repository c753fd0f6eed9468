// Limit cycles of all tests with a requirement, on a logarithmic scale.

const SYMBOLS = ["circle", "rect", "triangle", "diamond", "emptyCircle", "emptyRect"];
const SMALLEST = 0.01; // µm; smaller cycles are drawn here

function drawStability() {
  const limit = data.rules.stability.limit_cycle * 1e6;
  const tests = [...new Set(data.stability.map((row) => row.test))];
  const hues = ["one", "two", "three", "four", "limit"].map(colour);
  const known = data.stability.filter((row) => row.limit_cycle !== null);
  const poses = new Map(data.configurations.map((entry) => [entry.index, entry]));
  const failed = data.stability.filter((row) => row.passed === false);
  const open = data.stability.filter((row) => row.passed === null).length;
  const unknown = data.stability.length - known.length;
  const indices = [...poses.keys()];
  chart("stability-chart", {
    color: hues,
    legend: legend({ itemWidth: 12, itemHeight: 12 }),
    toolbox: toolbox(false),
    tooltip: tooltip({ trigger: "item", formatter: ({ data: point }) => echarts.format.encodeHTML(`${point.id}: ${figures(point.micro)} µm`) }),
    grid: { left: 66, right: 24, top: 66, bottom: 56 },
    xAxis: axis("Configuration", { min: Math.min(...indices) - 0.5, max: Math.max(...indices) + 0.5, minInterval: 1, axisLabel: { color: colour("soft"), formatter: (value) => (Number.isInteger(value) ? String(value) : "") } }),
    yAxis: axis("Limit cycle [µm]", { type: "log", min: SMALLEST, max: 10 ** Math.ceil(Math.log10(1.3 * Math.max(limit, ...known.map((row) => row.limit_cycle * 1e6)))), nameGap: 44, axisLabel: { color: colour("soft"), formatter: (value) => String(value) } }),
    series: tests.map((test, number) => ({
      type: "scatter",
      name: test,
      symbol: SYMBOLS[number % SYMBOLS.length],
      symbolSize: 9,
      data: known.filter((row) => row.test === test).map((row) => {
        const micro = row.limit_cycle * 1e6;
        return { id: row.id, micro, value: [row.configuration + (number - (tests.length - 1) / 2) * 0.14, Math.max(micro, SMALLEST)] };
      }),
      ...(number ? {} : { markLine: { silent: true, symbol: "none", data: [level(limit, `${limit} µm`)] } }),
    })),
  }, `${data.stability.length} tests over the configurations: ${failed.length} failed: a lasting limit cycle of ${limit} µm or more, unstable, or ended by the controller.` +
    (open ? ` ${open} not judged: skipped or lost.` : "") +
    (unknown ? ` ${unknown} have no amplitude and stand in the table only.` : ""));
}
