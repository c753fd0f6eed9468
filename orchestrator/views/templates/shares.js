// What V consists of: the share of every criterion beside its share on target.

function drawShares() {
  const rows = data.criteria;
  const known = rows.filter((row) => row.share !== null);
  const largest = known.reduce((best, row) => (best && best.share >= row.share ? best : row), null);
  bars("share-chart", {
    names: rows.map((row) => `${row.name} ${row.title}`),
    series: [
      { name: "on target", hue: "soft", values: rows.map((row) => row.weight), itemStyle: { color: colour("soft"), opacity: 0.5 } },
      { name: "this controller", hue: "accent", values: rows.map((row) => row.share), label: barLabels() },
    ],
    text: largest ? `${largest.name}, ${largest.title.toLowerCase()}, has the largest share of V: ${figures(largest.share)}, ${figures(largest.share / largest.weight)} times its share on target.` : "No criterion has a value.",
  });
}
