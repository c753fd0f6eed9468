"use strict";
// What every page needs: its data, elements, tabs, light and dark.

const $ = (selector, root = document) => root.querySelector(selector);
const data = JSON.parse($("#data").textContent);

/** A column packed by Python: base64 of little-endian single-precision numbers. */
function unpack(text) {
  return new Float32Array(Uint8Array.from(atob(text), (character) => character.charCodeAt(0)).buffer);
}

/** An element with attributes and children; text is never taken for markup. */
const element = (name, ...more) => filled(document.createElement(name), ...more);

/** The same for SVG. */
const drawn = (name, ...more) => filled(document.createElementNS("http://www.w3.org/2000/svg", name), ...more);

function filled(made, attributes = {}, ...children) {
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

/** The select `id`, filled once with pairs of value and text; `draw` is called when another one is chosen. */
function options(id, entries, draw, chosen = 0) {
  const select = $(`#${id}`);
  if (select.options.length) return select;
  select.append(...entries.map(([value, text]) => element("option", { value }, text)));
  select.selectedIndex = chosen;
  select.addEventListener("change", draw);
  return select;
}

/** The command that repeats the case `id`, with a button that copies it. */
function commandLine(id, command) {
  const label = `copy the command that repeats ${id}`;
  return element("p", { class: "command" }, element("code", {}, command), " ", element("button", { type: "button", class: "copy", "data-copy": command, "aria-label": label }, "copy"));
}

document.addEventListener("click", ({ target }) => {
  const button = target.closest("[data-copy]");
  if (!button) return;
  const field = element("textarea", { "aria-hidden": "true" }); // a page in a file may have no clipboard of its own
  field.value = button.dataset.copy;
  document.body.append(field);
  field.select();
  const copied = document.execCommand("copy");
  field.remove();
  button.focus();
  button.textContent = copied ? "copied" : "not copied";
  setTimeout(() => (button.textContent = "copy"), 2000);
});

document.addEventListener("input", ({ target }) => {
  if (!target.matches(".filter")) return;
  const wanted = target.value.toLowerCase().split(/\s+/);
  for (const row of target.closest(".card").querySelectorAll("tbody tr")) row.hidden = !wanted.every((word) => row.textContent.toLowerCase().includes(word));
});

/** A number with three figures, four from 100 on; a dash for none. */
function figures(value) {
  if (value === null || value === undefined) return "-";
  return Math.abs(value) < 100 ? String(Number(value.toPrecision(3))) : value.toFixed(1);
}

const degrees = (angle) => `${Math.round((angle * 180) / Math.PI)}°`;

/** The colour a CSS variable stands for now. */
function colour(name) {
  const probe = $("#theme");
  probe.style.color = `var(--${name})`;
  const found = getComputedStyle(probe).color;
  probe.style.color = "";
  return found;
}

const views = new Map();

/** Let `draw` be called whenever the panel `id` is shown or light and dark change. */
const view = (id, draw) => views.set(id, draw);

/** Show the panel `id`; its name becomes part of the address, so that a link can point at it. */
function show(id) {
  openPanel(id);
  history.replaceState(null, "", `#${id}`);
}

function openPanel(id) {
  for (const panel of document.querySelectorAll('[role="tabpanel"]')) panel.classList.toggle("shown", panel.id === id);
  for (const tab of document.querySelectorAll('[role="tab"]')) {
    const chosen = tab.getAttribute("aria-controls") === id;
    tab.setAttribute("aria-selected", String(chosen));
    tab.tabIndex = chosen ? 0 : -1;
    if (chosen) tab.scrollIntoView({ block: "nearest", inline: "nearest" });
  }
  if (views.has(id)) views.get(id)();
}

const shownPanel = () => $('[role="tabpanel"].shown').id;

function startPage() {
  const tabs = [...document.querySelectorAll('[role="tab"]')];
  tabs.forEach((tab, index) => {
    tab.addEventListener("click", () => show(tab.getAttribute("aria-controls")));
    tab.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      const number = event.key === "Home" ? 0 : event.key === "End" ? tabs.length - 1 : index + step;
      if (Number.isNaN(number)) return;
      event.preventDefault();
      const next = tabs[(number + tabs.length) % tabs.length];
      next.focus();
      next.click();
    });
  });
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const redraw = () => views.has(shownPanel()) && views.get(shownPanel())();
  dark.addEventListener("change", redraw);
  $("#theme").addEventListener("click", () => {
    const root = document.documentElement;
    const now = root.dataset.theme || (dark.matches ? "dark" : "light");
    root.dataset.theme = now === "dark" ? "light" : "dark";
    redraw();
  });
  document.documentElement.classList.add("scripted");
  const wanted = location.hash.slice(1);
  openPanel(tabs.some((tab) => tab.getAttribute("aria-controls") === wanted) ? wanted : tabs[0].getAttribute("aria-controls"));
}
