// A map of the workspace: a table of buttons, one a configuration, so that it is read and walked like any table.

// Viridis, by nine of its colours: even in lightness, and told apart by colour-blind readers.
const VIRIDIS = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"];
// Purple to orange through white (ColorBrewer PuOr), for differences.
const PUOR = ["#542788", "#8073ac", "#b2abd2", "#d8daeb", "#f7f7f7", "#fee0b6", "#fdb863", "#e08214", "#b35806"];

/** The colour at `place` from 0 to 1. */
function blended(colours, place) {
  const at = Math.min(Math.max(place, 0), 1) * (colours.length - 1);
  const index = Math.min(Math.floor(at), colours.length - 2);
  const channels = (text) => [1, 3, 5].map((start) => parseInt(text.slice(start, start + 2), 16));
  const [low, high] = [channels(colours[index]), channels(colours[index + 1])];
  return low.map((value, channel) => Math.round(value + (at - index) * (high[channel] - value)));
}

/** Black or white, whichever reads better on `channels` (relative luminance after WCAG). */
function readable(channels) {
  const [r, g, b] = channels.map((value) => ((value / 255 <= 0.04045) ? value / 255 / 12.92 : ((value / 255 + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b > 0.179 ? "#000" : "#fff";
}

/** The map, and beside it the arm among `dots` in the pose that is pointed at, with what `about` says of it. */
function workspaceMap({ about, dots = [], ...map }) {
  const { svg, world } = stage("The arm in the pose of the chosen configuration");
  const arm = armDrawing(colour("accent"));
  world.append(...dots, arm.group);
  $("#arm").replaceChildren(svg);
  const chosen = (configuration) => {
    const { index, q_a1, q_a2 } = configuration;
    arm.pose(q_a1, q_a2);
    $("#arm-text").textContent = `Configuration ${index}: q_a1 ${degrees(q_a1)}, q_a2 ${degrees(q_a2)}; ${about(configuration)}`;
  };
  heatMap($("#heat"), { configurations: data.configurations, chosen, ...map });
}

/**
 * Draw the map into `place`. `value(configuration)` may be null; `chosen(configuration)` is called on pointer and focus.
 * `range` is [smallest, largest], `name` what is shown. `ends` are the words at the ends of the colour bar; where `told`
 * is given, there is nothing to tell apart, and it stands for the bar.
 */
function heatMap(place, { configurations, value, range, colours, name, chosen, ends, told }) {
  const angles = (key, sign) => [...new Set(configurations.map((entry) => entry[key]))].sort((a, b) => sign * (a - b));
  const columns = angles("q_a1", 1);
  const buttons = new Map();
  const select = (configuration) => {
    for (const [other, button] of buttons) {
      button.setAttribute("aria-pressed", String(other === configuration));
      button.tabIndex = other === configuration ? 0 : -1;
    }
    chosen(configuration);
  };
  const rows = angles("q_a2", -1).map((q_a2) =>
    element("tr", {}, element("th", { scope: "row" }, degrees(q_a2)), ...columns.map((q_a1) => {
      const configuration = configurations.find((entry) => entry.q_a1 === q_a1 && entry.q_a2 === q_a2);
      if (!configuration) return element("td");
      const shown = value(configuration);
      const label = `${name} ${figures(shown)} at q_a1 ${degrees(q_a1)}, q_a2 ${degrees(q_a2)}`;
      const button = element("button", { type: "button", "aria-label": label, "aria-pressed": "false", tabindex: -1 }, figures(shown));
      if (shown !== null) {
        const channels = blended(colours, (shown - range[0]) / (range[1] - range[0] || 1));
        button.style.background = `rgb(${channels})`;
        button.style.color = readable(channels);
      }
      for (const happening of ["pointerenter", "focus", "click"]) button.addEventListener(happening, () => select(configuration));
      buttons.set(configuration, button);
      return element("td", {}, button);
    }))
  );
  const table = element("table", { class: "heat", "aria-describedby": `${place.id}-text` },
    element("thead", {}, element("tr", {}, element("th", { scope: "col" }, "q_a2 \\ q_a1"), ...columns.map((angle) => element("th", { scope: "col" }, degrees(angle))))),
    element("tbody", {}, ...rows));
  table.addEventListener("keydown", (event) => {
    const step = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowDown: [1, 0], ArrowUp: [-1, 0] }[event.key];
    if (!step) return;
    event.preventDefault();
    const cell = event.target.closest("td");
    const row = table.tBodies[0].rows[cell.parentNode.sectionRowIndex + step[0]];
    const next = row && row.cells[cell.cellIndex + step[1]];
    if (next && next.firstChild && next.tagName === "TD") next.firstChild.focus();
  });
  const strip = element("i");
  strip.style.background = `linear-gradient(to right, ${colours.join(",")})`;
  const legend = told ? [told] : [element("span", {}, ends[0]), strip, element("span", {}, ends[1])];
  place.replaceChildren(
    element("div", { class: "scroll" }, table),
    element("p", { class: "caption", id: `${place.id}-text` }, `${name} over the link angles: q_a1 to the right, q_a2 upwards. Arrow keys move between configurations.`),
    element("div", { class: "legend" }, ...legend));
  if (configurations.length) select(configurations.reduce((best, entry) => ((value(entry) ?? 0) > (value(best) ?? 0) ? entry : best)));
}
