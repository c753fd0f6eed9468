// Charts over time or in the plane, by ECharts: one look, zoom and read-off everywhere.

/** Show `option` in the element `id`; what was there is replaced. `text` stands below, and for those who cannot see. */
function chart(id, option, text) {
  const place = $(`#${id}`);
  const made = echarts.getInstanceByDom(place) || echarts.init(place);
  made.resize(); // its place may have changed since it was last drawn
  made.setOption(
    {
      animation: false,
      textStyle: { fontFamily: getComputedStyle(document.body).fontFamily },
      ...option,
      aria: { enabled: true, label: { description: text }, ...option.aria },
    },
    { notMerge: true }
  );
  $(`#${id}-text`).textContent = text;
  place.setAttribute("role", "img");
  place.setAttribute("aria-label", text);
  return made;
}

window.addEventListener("resize", () => {
  for (const place of document.querySelectorAll(".chart")) {
    const made = echarts.getInstanceByDom(place);
    if (made && place.clientWidth) made.resize();
  }
});

function axis(name, more = {}) {
  const soft = colour("soft");
  return {
    type: "value",
    name,
    nameLocation: "middle",
    nameGap: 30,
    nameTextStyle: { color: soft, fontSize: 13 },
    axisLabel: { color: soft, hideOverlap: true, formatter: (value) => (typeof value === "number" ? String(Number(value.toFixed(6))) : value) },
    axisLine: { show: true, onZero: false, lineStyle: { color: soft } },
    splitLine: { lineStyle: { color: colour("line") } },
    ...more,
  };
}

const tooltip = (more = {}) => (
  { backgroundColor: colour("card"), borderColor: colour("line"), textStyle: { color: colour("ink") }, confine: true, ...more });

/** A legend whose symbols are as high as the text, which is cut to them. */
const legend = (more = {}) => ({
  type: "scroll", top: 32, left: 12, right: 12, itemWidth: 16, itemHeight: 15,
  textStyle: { color: colour("ink") }, inactiveColor: colour("line"), pageTextStyle: { color: colour("soft") }, ...more,
});

/** Tools of a chart. Filtering by the vertical axis would break lines where they leave the chart. */
function toolbox(zoom) {
  const iconStyle = { borderColor: colour("soft") };
  const all = { restore: { title: "As at first" }, saveAsImage: { title: "Save as PNG", backgroundColor: colour("card") } };
  return { right: 12, top: 2, iconStyle, feature: zoom ? { dataZoom: { filterMode: "none", title: { zoom: "Zoom to a box", back: "Back" } }, ...all } : all };
}

/** A rim around text that stands on lines or bars. */
const halo = () => ({ textBorderColor: colour("card"), textBorderWidth: 4 });

const marked = (name, hue = "limit", position = "insideEndTop") => ({
  name,
  lineStyle: { color: colour(hue), type: "dashed", width: 1.5 },
  label: { formatter: name, color: colour(hue), ...halo(), position },
});

/** A level drawn across a chart whose axis reaches it: a target or a limit. */
const level = (value, name, ...look) => ({ yAxis: value, ...marked(name, ...look) });

const TARGET_STEP = 0.005; // s
const CHARACTER = 6.4; // pixels, of a label

/**
 * A level that holds from one time [s] to another, named at its end, as a line of the chart `id`. It has many points:
 * what is outside the times in sight is left out by the point, a mark by both ends as soon as one is outside.
 */
function targetLine(id, { value, name, from, to }) {
  const count = Math.max(1, Math.ceil((to - from) / TARGET_STEP));
  const words = `${name} ${figures(value)} mm`;
  const fits = ([time, height]) => {
    const made = echarts.getInstanceByDom($(`#${id}`));
    const pixel = [made.convertToPixel({ xAxisIndex: 0 }, time) - CHARACTER * words.length, made.convertToPixel({ yAxisIndex: 0 }, height)];
    return made.containPixel({ gridIndex: 0 }, pixel);
  };
  return {
    type: "line",
    name: words,
    data: Array.from({ length: count + 1 }, (_, step) => [from + ((to - from) * step) / count, value]),
    silent: true,
    tooltip: { show: false },
    showSymbol: false,
    lineStyle: { color: colour("limit"), type: "dashed", width: 1.5 },
    endLabel: {
      show: true, formatter: (point) => (fits(point.value) ? words : ""), color: colour("limit"), ...halo(),
      align: "right", verticalAlign: "bottom", distance: 0, padding: [0, 4, 3, 0],
    },
    z: 6,
  };
}

/**
 * Lines over time [s]. `lines` hold name, t, y, colour, width or opacity where they differ, and `quiet` where they are
 * not read off; lines of one name share an entry of the legend. `levels` are drawn across, `targets` (value, name,
 * from, to) from one time to another, `spans` (from, to, name) shaded. The vertical axis fits what is in sight, or ends
 * at `top` or at +- `bound`; `legend` stands for the usual one.
 */
function overTime(id, { lines, unit, label, levels = [], targets = [], spans = [], from, to, top, bound, text, legend: names }) {
  const ends = bound ? { min: -bound, max: bound, axisLabel: { color: colour("soft"), showMinLabel: false, showMaxLabel: false } } : { max: top, boundaryGap: [0, "12%"] };
  const shaded = {
    silent: true,
    itemStyle: { color: colour("area") },
    label: { color: colour("soft"), position: "insideTop" },
    // Shorter by a little: a span that ends where the times in sight begin would show its name without an area.
    data: spans.map((span) => [{ xAxis: span.from, name: span.name }, { xAxis: span.to - 1e-6 }]),
  };
  return chart(id, {
    legend: { ...(names || legend({ icon: "roundRect", data: [...new Set(lines.map((line) => line.name))] })), show: lines.length > 1 },
    toolbox: toolbox(true),
    tooltip: tooltip({
      trigger: "axis",
      axisPointer: { type: "cross", label: { precision: 4 } },
      valueFormatter: (value) => (value === undefined || value === null ? "-" : `${Number(value).toPrecision(4)} ${unit}`),
    }),
    grid: { left: 62, right: 24, top: lines.length > 1 ? 66 : 40, bottom: 84 },
    // The ends of the times in sight are seldom round: labels there would stand unevenly beside the others.
    xAxis: axis("Time [s]", { min: "dataMin", max: "dataMax", axisLabel: { color: colour("soft"), hideOverlap: true, showMinLabel: false, showMaxLabel: false, formatter: (value) => String(Number(value.toFixed(3))) }, axisPointer: { label: { precision: 4 } } }),
    yAxis: axis(`${label} [${unit}]`, { nameGap: 44, ...ends }),
    dataZoom: [
      { type: "inside", zoomOnMouseWheel: "ctrl", moveOnMouseWheel: false, startValue: from, endValue: to },
      { type: "slider", bottom: 10, height: 22, startValue: from, endValue: to, brushSelect: false, labelPrecision: 2, textStyle: { color: colour("soft") } },
    ],
    series: [
      ...lines.map((line, index) => ({
        type: "line",
        name: line.name,
        data: Array.from(line.t, (t, row) => [t, line.y[row]]),
        showSymbol: false,
        itemStyle: { color: line.colour },
        ...(line.quiet ? { tooltip: { show: false } } : {}),
        lineStyle: { width: line.width || 1.4, opacity: line.opacity || 1, type: line.dash || "solid" },
        z: line.z || 2,
        emphasis: { disabled: true },
        ...(index === 0 ? { markLine: { silent: true, symbol: "none", data: levels }, markArea: shaded } : {}),
      })),
      ...targets.map((target) => targetLine(id, target)),
    ],
  }, text);
}

/** Horizontal bars in the element `id`, the first of `names` on top; `series` hold name, hue, values and more. */
function bars(id, { names, series, label = "", grid = {}, labels = {}, ends = {}, text, ...more }) {
  return chart(id, {
    legend: legend({ top: 0, icon: "roundRect", show: series.length > 1 }),
    tooltip: tooltip({ trigger: "axis", axisPointer: { type: "shadow" }, valueFormatter: figures }),
    grid: { left: 120, right: 44, top: series.length > 1 ? 28 : 12, bottom: label ? 44 : 24, ...grid },
    xAxis: axis(label, ends),
    yAxis: axis("", { type: "category", inverse: true, data: names, axisLabel: { color: colour("ink"), interval: 0, ...labels } }),
    series: series.map(({ hue, values, ...rest }) => ({ type: "bar", itemStyle: { color: colour(hue) }, data: values, barGap: "10%", barCategoryGap: "14%", ...rest })),
    ...more,
  }, text);
}

/** Values at the ends of bars. */
const barLabels = () => ({ show: true, position: "right", color: colour("ink"), formatter: ({ value }) => figures(value) });

/** How a chart of the TCP error is labelled. */
const TCP_ERROR = { unit: "mm", label: "TCP position error" };

/** Times [s] and TCP error [mm] of a thinned recording, unpacked once. */
function curve(recording) {
  if (!recording.unpacked) {
    const [t, error] = recording.curve.map(unpack);
    recording.unpacked = { t, error: error.map((metre) => 1e3 * metre) };
  }
  return recording.unpacked;
}

const criterion = (name) => data.criteria.find((entry) => entry.name === name);

/** The largest error [mm] and its time [s] between two times; both null where nothing was recorded between them. */
function peak({ t, error }, from, to) {
  let [best, at] = [null, null];
  for (let row = 0; row < t.length; row += 1) {
    if (t[row] >= from && t[row] <= to && (best === null || error[row] > best)) [best, at] = [error[row], t[row]];
  }
  return [best, at];
}

/** What the TCP error [mm] is to stay below in a case, and when [s]: chirp, force, and when it is to have settled. */
function errorTargets({ window: [begin, end], chirp, time }) {
  const due = end + criterion("B6").target;
  return [
    { value: criterion("B7").target * 1e3, name: "B7 target", from: chirp[0], to: Math.min(begin, time) },
    { value: criterion("B5").target * 1e3, name: "B5 target", from: begin, to: Math.min(due, time) },
    { value: data.rules.settling_error * 1e3, name: "settled", from: due, to: time },
  ].filter((target) => target.from < target.to);
}

/** The largest error [mm] to show of an error that settles to `largest`: the band of the settled TCP is to be seen. */
const settlingTop = (largest) => Math.max(5 * data.rules.settling_error * 1e3, Number((1.2 * largest).toPrecision(2)));

/** Show the times from `from` to `to` [s] in a chart over time, up to `top` or to what is in sight. */
function zoomTo(made, from, to, top) {
  made.setOption({ yAxis: { max: top ?? null } });
  made.dispatchAction({ type: "dataZoom", batch: [0, 1].map((dataZoomIndex) => ({ dataZoomIndex, startValue: from, endValue: to })) });
}
