// Plots of one quantity over another, as the page's data describe them.

for (const plot of data.plots || []) {
  const panel = $(`#${plot.id}`).closest('[role="tabpanel"]').id;
  const earlier = views.get(panel);
  view(panel, () => {
    if (earlier) earlier();
    const words = ({ name, x, y }) => `${name}: ${x.map((value, index) => `${figures(value)}: ${figures(y[index])}`).join(", ")}`;
    chart(plot.id, {
      legend: legend({ data: plot.series.map((each) => each.name) }),
      toolbox: toolbox(true),
      tooltip: tooltip({ trigger: "item", valueFormatter: (value) => (Array.isArray(value) ? value.map(figures).join(", ") : figures(value)) }),
      grid: { left: 64, right: 24, top: 66, bottom: 48 },
      xAxis: axis(plot.x, { type: plot.logarithmic ? "log" : "value", scale: true }),
      yAxis: axis(plot.y, { nameGap: 44 }),
      series: plot.series.map((each, index) => ({
        type: "line", name: each.name, symbolSize: 8, itemStyle: { color: colour(["one", "two", "three", "four", "five"][index % 5]) },
        data: each.x.map((x, point) => ({ value: [x, each.y[point]], ...(each.marked[point] ? { symbol: "diamond", symbolSize: 14, itemStyle: { color: colour("bad-fill") } } : {}) })),
        ...(index ? {} : { markLine: { silent: true, symbol: "none", data: plot.levels.map(([name, value]) => level(value, name)) } }),
      })),
    }, `${plot.title}. ${plot.series.map(words).join(". ")}.${plot.marked ? ` Marked: ${plot.marked}.` : ""}`);
  });
}
