// What V consists of: the share of every criterion beside its share on target.

function drawShares() {
  const rows = [...data.criteria].reverse();
  const bar = (name, hue, values, more) => ({ type: "bar", name, itemStyle: { color: colour(hue) }, data: values, barGap: "10%", barCategoryGap: "14%", ...more });
  const known = data.criteria.filter((row) => row.share !== null);
  const largest = known.reduce((best, row) => (best && best.share >= row.share ? best : row), null);
  chart("share-chart", {
    legend: legend({ top: 0, icon: "roundRect" }),
    tooltip: tooltip({ trigger: "axis", axisPointer: { type: "shadow" }, valueFormatter: figures }),
    grid: { left: 120, right: 44, top: 28, bottom: 24 },
    xAxis: axis("", {}),
    yAxis: axis("", { type: "category", data: rows.map((row) => `${row.name} ${row.title}`), axisLabel: { color: colour("ink") } }),
    series: [
      bar("on target", "soft", rows.map((row) => row.weight), { itemStyle: { color: colour("soft"), opacity: 0.5 } }),
      bar("this controller", "accent", rows.map((row) => row.share), { label: { show: true, position: "right", color: colour("ink"), formatter: ({ value }) => figures(value) } }),
    ],
  }, largest ? `${largest.name}, ${largest.title.toLowerCase()}, has the largest share of V: ${figures(largest.share)}, ${figures(largest.share / largest.weight)} times its share on target.` : "No criterion has a value.");
}
