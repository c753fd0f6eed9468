// Charts over time or in the plane, by ECharts: one look, zoom and read-off everywhere.

/** Show `option` in the element `id`; what was there is replaced. `text` stands below, and for those who cannot see. */
function chart(id, option, text) {
  const place = $(`#${id}`);
  const made = echarts.getInstanceByDom(place) || echarts.init(place);
  made.setOption(
    {
      animation: false,
      textStyle: { fontFamily: getComputedStyle(document.body).fontFamily },
      aria: { enabled: true, label: { description: text } },
      ...option,
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

const tooltip = (more = {}) => ({
  backgroundColor: colour("card"),
  borderColor: colour("line"),
  textStyle: { color: colour("ink") },
  confine: true,
  ...more,
});

const legend = (more = {}) => ({
  type: "scroll",
  top: 32,
  left: 12,
  right: 12,
  itemWidth: 16,
  itemHeight: 10,
  textStyle: { color: colour("ink") },
  inactiveColor: colour("line"),
  pageTextStyle: { color: colour("soft") },
  ...more,
});

function toolbox(zoom) {
  const iconStyle = { borderColor: colour("soft") };
  const all = { restore: { title: "Whole" }, saveAsImage: { title: "Save as PNG", backgroundColor: colour("card") } };
  return { right: 12, top: 2, iconStyle, feature: zoom ? { dataZoom: { title: { zoom: "Zoom to a box", back: "Back" } }, ...all } : all };
}

const marked = (name) => ({
  name,
  lineStyle: { color: colour("limit"), type: "dashed", width: 1.5 },
  label: { formatter: name, color: colour("limit"), position: "insideEndTop" },
});

/** A level drawn across a chart: a target or a limit. */
const level = (value, name) => ({ yAxis: value, ...marked(name) });

/** A level that holds from one time [s] to another. */
const levelWithin = (value, name, from, to) => [{ coord: [from, value], ...marked(name) }, { coord: [to, value] }];

/**
 * Lines over time [s]. `lines` hold name, t, y, colour, and width or opacity where they differ; `levels` are drawn
 * across, `spans` (from, to, name) shaded. The vertical axis fits what is in sight, or ends at +- `bound`.
 */
function overTime(id, { lines, unit, label, levels = [], spans = [], from, to, bound, text }) {
  const shaded = {
    silent: true,
    itemStyle: { color: colour("area") },
    label: { color: colour("soft"), position: "insideTop" },
    data: spans.map((span) => [{ xAxis: span.from, name: span.name }, { xAxis: span.to }]),
  };
  return chart(
    id,
    {
      color: lines.map((line) => line.colour),
      legend: legend({ show: lines.length > 1, icon: "roundRect" }),
      toolbox: toolbox(true),
      tooltip: tooltip({
        trigger: "axis",
        axisPointer: { type: "cross", label: { precision: 4 } },
        valueFormatter: (value) => (value === undefined || value === null ? "-" : `${Number(value).toPrecision(4)} ${unit}`),
      }),
      grid: { left: 62, right: 24, top: lines.length > 1 ? 66 : 40, bottom: 84 },
      xAxis: axis("Time [s]", { min: "dataMin", max: "dataMax", axisPointer: { label: { precision: 4 } } }),
      yAxis: axis(`${label} [${unit}]`, { nameGap: 44, ...(bound ? { min: -bound, max: bound, axisLabel: { color: colour("soft"), showMinLabel: false, showMaxLabel: false } } : {}) }),
      dataZoom: [
        { type: "inside", zoomOnMouseWheel: "ctrl", moveOnMouseWheel: false, startValue: from, endValue: to },
        { type: "slider", bottom: 10, height: 22, startValue: from, endValue: to, brushSelect: false, labelPrecision: 2, textStyle: { color: colour("soft") } },
      ],
      series: lines.map((line, index) => ({
        type: "line",
        name: line.name,
        data: Array.from(line.t, (t, row) => [t, line.y[row]]),
        showSymbol: false,
        lineStyle: { width: line.width || 1.4, opacity: line.opacity || 1 },
        z: line.z || 2,
        emphasis: { disabled: true },
        ...(index === 0 ? { markLine: { silent: true, symbol: "none", data: levels }, markArea: shaded } : {}),
      })),
    },
    text
  );
}

/** Show the times from `from` to `to` [s] in a chart over time. */
const zoomTo = (made, from, to) =>
  made.dispatchAction({ type: "dataZoom", batch: [0, 1].map((dataZoomIndex) => ({ dataZoomIndex, startValue: from, endValue: to })) });
