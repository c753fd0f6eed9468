// Maps: a table of buttons, one a cell, so that it is read and walked like any table.

// Viridis, by nine of its colours: even in lightness, and told apart by colour-blind readers.
const VIRIDIS = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"];
// Purple to orange through white (ColorBrewer PuOr), for what has a middle.
const PUOR = ["#542788", "#8073ac", "#b2abd2", "#d8daeb", "#f7f7f7", "#fee0b6", "#fdb863", "#e08214", "#b35806"];

const SMALL = 12; // columns from which on cells are small

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

/** The select `id`, made once in the bar of the map; `draw` is called when another entry is chosen. */
function choiceOf(bar, id, label, entries, chosen, draw) {
  if (!$(`#${id}`)) {
    bar.append(element("label", { for: id }, label), element("select", { id, onchange: draw }, ...entries.map((text) => element("option", {}, text))));
    $(`#${id}`).selectedIndex = chosen;
  }
  return entries[$(`#${id}`).selectedIndex];
}

/** What is shown of a map: values by cell, their name, what is said of a cell, and the words at the ends of the scale. */
function shownOf(place, heat, bar) {
  const [of, names] = ["of", "name"].map((field) => [...new Set(heat.layers.map((layer) => layer[field]))]);
  const draw = () => drawHeat(place);
  const pair = heat.smaller ? ["minuend", "subtrahend"].map((part, index) => choiceOf(bar, `${place.id}-${part}`, ["Show", "minus"][index], of, 1 - index, draw)) : [of[0]];
  const name = names.length > 1 ? choiceOf(bar, `${place.id}-layer`, heat.smaller ? "of" : "Show", names, 0, draw) : names[0];
  const layer = (owner, layerName) => heat.layers.find((one) => one.of === owner && one.name === layerName);
  const [first, second] = pair.map((owner) => layer(owner, name));
  const at = (one, cell) => one.values[cell];
  if (!second) {
    const all = heat.layers.filter((one) => one.of === pair[0]);
    const about = (cell) => all.map((one) => `${one.symbol} ${figures(at(one, cell))}`).join(", ");
    const target = first.target === null ? "" : ` (on target: ${figures(first.target)})`;
    return { name: first.symbol, about, marked: first.marked, values: first.values, ends: (low, high) => [figures(low), `${figures(high)}${target}`] };
  }
  const values = first.values.map((value, cell) => (value === null || at(second, cell) === null ? null : value - at(second, cell)));
  const about = (cell) => `${first.symbol}: ${pair.map((owner, index) => `${owner} ${figures(at([first, second][index], cell))}`).join(", ")}`;
  const ends = (low, high) => [`${figures(low)}: ${pair[0]} ${heat.smaller}`, `${figures(high)}: ${pair[1]} ${heat.smaller}`];
  return { name: `Difference of ${first.symbol}`, about, marked: [], values, ends };
}

/** Smallest and largest value of the colours; none if there is nothing to tell apart. */
function rangeOf({ limits, aroundZero }, values) {
  const known = values.filter((value) => value !== null);
  if (limits || !known.length) return limits || [];
  const largest = Math.max(...known.map(Math.abs));
  const range = aroundZero ? [-largest, largest] : [Math.min(...known), Math.max(...known)];
  return range[0] === range[1] && aroundZero ? [] : range;
}

function drawHeat(place) {
  const heat = data.heats[place.id];
  if (!place.firstChild) place.append(element("p", { class: "bar" }), element("div", { class: "scroll" }), element("p", { class: "caption", id: `${place.id}-text` }), element("div", { class: "legend" }), element("p", { class: "caption", id: `${place.id}-cell`, "aria-live": "polite" }));
  const [bar, scroll, caption, legend, said] = place.children;
  const { name, about, marked, values, ends } = shownOf(place, heat, bar);
  bar.hidden = !bar.firstChild;
  const [low, high] = rangeOf(heat, values);
  const colours = heat.aroundZero ? PUOR : VIRIDIS;
  const hues = values.map((value) => (value === null ? null : blended(colours, low === undefined ? 0.5 : (value - low) / (high - low || 1))));
  const buttons = new Map();
  const select = (cell) => {
    for (const [other, button] of buttons) {
      button.setAttribute("aria-pressed", String(other === cell));
      button.tabIndex = other === cell ? 0 : -1;
    }
    said.textContent = `${heat.cells[cell]}; ${about(cell)}`;
    place.dispatchEvent(new CustomEvent("pointed", { detail: { cell, hues } }));
  };
  const cellOf = (cell) => {
    if (heat.cells[cell] === null) return element("td");
    const shown = figures(values[cell]) + (marked.includes(cell) ? " ×" : "");
    const button = element("button", { type: "button", "aria-label": `${name} ${shown} at ${heat.cells[cell]}`, "aria-pressed": "false", tabindex: -1 }, shown);
    if (hues[cell]) {
      button.style.background = `rgb(${hues[cell]})`;
      button.style.color = readable(hues[cell]);
    }
    for (const happening of ["pointerenter", "focus", "click"]) button.addEventListener(happening, () => select(cell));
    buttons.set(cell, button);
    return element("td", {}, button);
  };
  const count = heat.columns.length;
  scroll.replaceChildren(element("table", { class: count > SMALL ? "heat small" : "heat", "aria-describedby": caption.id, onkeydown: walk },
    element("thead", {}, element("tr", {}, element("th", { scope: "col" }, heat.corner), ...heat.columns.map((text) => element("th", { scope: "col" }, text)))),
    element("tbody", {}, ...heat.rows.map((text, row) => element("tr", {}, element("th", { scope: "row" }, text), ...heat.columns.map((_, column) => cellOf(row * count + column)))))));
  caption.textContent = `${name}: ${heat.text} Arrow keys move between the cells.`;
  const strip = element("i");
  strip.style.background = `linear-gradient(to right, ${colours.join(",")})`;
  const known = values.some((value) => value !== null);
  const words = low === undefined ? [] : ends(low, high);
  legend.replaceChildren(...(words.length ? [element("span", {}, words[0]), strip, element("span", {}, words[1])] : [known ? "no difference" : "no values"]));
  if (buttons.size) select([...buttons.keys()].reduce((best, cell) => ((values[cell] ?? 0) > (values[best] ?? 0) ? cell : best)));
}

/** Move the focus by an arrow key. */
function walk(event) {
  const step = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowDown: [1, 0], ArrowUp: [-1, 0] }[event.key];
  if (!step) return;
  event.preventDefault();
  const cell = event.target.closest("td");
  const row = cell.closest("tbody").rows[cell.parentNode.sectionRowIndex + step[0]];
  const next = row && row.cells[cell.cellIndex + step[1]];
  if (next && next.firstChild && next.tagName === "TD") next.firstChild.focus();
}

painters.set(".heat-map", drawHeat);
