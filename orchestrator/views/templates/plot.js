// Plots as the page's data describe them: options of ECharts, to which come the scheme's colours, sizes, and numbers.

const SEGMENT = 0.005; // the width that a segment has a point for
const CHARACTER = 6.4; // pixels, of a label

/** A number as a label of an axis. */
const labelled = (value) => (typeof value === "number" ? String(Number(value.toPrecision(6))) : value);

/** The option with colours of the scheme in use in place of their names. */
function coloured(value, key = "") {
  if (typeof value === "string") return /olor$/.test(key) && value.startsWith("@") ? colour(value.slice(1)) : value;
  if (Array.isArray(value)) return value.map((item) => coloured(item, key));
  if (value === null || typeof value !== "object") return value;
  return Object.fromEntries(Object.entries(value).map(([name, inner]) => [name, coloured(inner, name)]));
}

/** The points of a series: as they are, of rows of two columns, or of a segment [from, to, height]. */
function points(given) {
  if (given.columns) {
    const [x, y] = given.columns.map((number) => (given.rows ? column(number).subarray(...given.rows) : column(number)));
    return Array.from(x, (value, row) => [value, y[row]]);
  }
  if (!given.segment) return given;
  const [from, to, height] = given.segment;
  const count = Math.max(1, Math.ceil((to - from) / SEGMENT));
  return Array.from({ length: count + 1 }, (_, step) => [from + ((to - from) * step) / count, height]);
}

/** The name of a segment where it ends in sight, if it has room there. */
const segmentName = (place, name) => ({ value: [end, height] }) => {
  const made = echarts.getInstanceByDom(place);
  const pixel = [made.convertToPixel({ xAxisIndex: 0 }, end) - CHARACTER * name.length, made.convertToPixel({ yAxisIndex: 0 }, height)];
  return made.containPixel({ gridIndex: 0 }, pixel) ? name : "";
};

/** What is read of a point or a bar: its own words, or its numbers. */
const told = (unit) => ({ data: point, seriesName, value }) => {
  if (point && point.words !== undefined) return data.texts[point.words].split("\n").map(echarts.format.encodeHTML).join("<br>");
  const numbers = (Array.isArray(value) ? value : [value]).map((number) => (typeof number === "number" ? figures(number) : "-")).join(", ");
  return echarts.format.encodeHTML(`${seriesName}: ${numbers} ${unit}`);
};

/** Sizes that depend on the room of `place`. */
function fit(place, option, { rows, square }) {
  const wide = place.clientWidth;
  option.legend.textStyle.width = Math.max(80, wide - 100);
  if (rows) {
    const [count, height] = rows;
    const room = wide < 600 ? wide / 2.4 : Math.min(380, wide / 3);
    const names = data.plots[place.id].names.y;
    const lines = Math.max(1, ...names.map((name) => Math.ceil((8 * name.length) / room)));
    if (lines > 1) Object.assign(option.yAxis.axisLabel, { width: room, lineHeight: 16, overflow: "break" });
    place.style.height = `${option.grid.top + option.grid.bottom + count * Math.max(height, 16 * lines + 4)}px`;
  }
  if (square) {
    const above = option.grid.top;
    place.style.height = `${Math.min(480, wide + above - 28)}px`; // the square, and what stands around it
    const side = Math.min(wide - 84, place.clientHeight - above - 56);
    Object.assign(option.grid, { left: Math.max(66, (wide - side) / 2), width: side, height: side });
  }
  hideNames(option, wide);
}

/** Bands without their names where these have no room. */
function hideNames(option, wide) {
  const { min, max } = option.xAxis;
  if (typeof min !== "number" || typeof max !== "number") return;
  for (const [from, to] of option.series.flatMap((one) => (one.markArea ? one.markArea.data : []))) {
    if (((wide - 80) * (to.xAxis - from.xAxis)) / (max - min) < CHARACTER * from.name.length + 6) from.name = "";
  }
}

/** Draw the plot of the element `place`; what was there is replaced. */
function drawPlot(place) {
  const given = data.plots[place.id];
  const option = coloured(given.option);
  option.textStyle = { fontFamily: getComputedStyle(document.body).fontFamily };
  fit(place, option, given);
  for (const axis of ["x", "y"]) {
    const scale = option[`${axis}Axis`];
    const names = given.names[axis];
    if (scale.type !== "category") scale.axisLabel.formatter = names.length ? (value) => names[value] ?? "" : labelled;
  }
  option.tooltip.formatter = option.tooltip.trigger === "item" ? told(given.unit) : undefined;
  option.tooltip.valueFormatter = (value) => (typeof value === "number" ? `${figures(value, 4)} ${given.unit}` : "-");
  for (const one of option.series) {
    if (one.data.segment) one.endLabel.formatter = segmentName(place, one.name);
    one.data = points(one.data);
  }
  for (const other of document.querySelectorAll(".option[data-hidden] .chart")) echarts.dispose(other); // canvases take room
  const made = echarts.getInstanceByDom(place) || echarts.init(place);
  made.resize(); // its place may have changed since it was last drawn
  made.setOption(option, { notMerge: true });
  made.group = given.group;
  if (given.group) echarts.connect(given.group);
  $(`#${place.id}-text`).textContent = given.text;
  place.setAttribute("role", "img");
  place.setAttribute("aria-label", given.text);
}

/** Show the part of a chart from and to on `x` and `y`; an end of y that is not given is where the values end. */
function zoomTo(made, { x, y: [low, high] }) {
  if (data.plots[made.getDom().id].square) made.setOption({ xAxis: { min: x[0], max: x[1] }, yAxis: { min: low, max: high } });
  else {
    made.setOption({ yAxis: { min: low, max: high } });
    if (x) made.dispatchAction({ type: "dataZoom", batch: [0, 1].map((dataZoomIndex) => ({ dataZoomIndex, startValue: x[0], endValue: x[1] })) });
  }
}

document.addEventListener("click", ({ target }) => {
  const button = target.closest("[data-window]");
  if (!button) return;
  const { plot, window: number } = button.dataset;
  zoomTo(echarts.getInstanceByDom($(`#${plot}`)), data.plots[plot].windows[number]);
});

window.addEventListener("resize", () => {
  for (const place of document.querySelectorAll(".chart")) {
    const made = echarts.getInstanceByDom(place);
    if (made && place.clientWidth) made.resize();
  }
});

painters.set(".chart", drawPlot);
