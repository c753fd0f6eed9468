"use strict";
// What every page needs: its data, elements, tabs, light and dark.

const $ = (selector, root = document) => root.querySelector(selector);
const data = JSON.parse($("#data").textContent);

const unpacked = [];

/** A column by its number, unpacked once: Python packs it as base64 of little-endian single-precision numbers. */
function column(number) {
  unpacked[number] ||= new Float32Array(Uint8Array.from(atob(data.columns[number]), (character) => character.charCodeAt(0)).buffer);
  return unpacked[number];
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
  const words = target.value.toLowerCase().split(/\s+/);
  for (const row of target.closest(".card").querySelectorAll("tbody tr")) row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word));
});

/** A number with so many figures, all before the point from 100 on; a dash for none. */
function figures(value, count = 3) {
  if (value === null || value === undefined) return "-";
  return Math.abs(value) < 100 ? String(Number(value.toPrecision(count))) : value.toFixed(1);
}

/** The colour that a CSS variable stands for now. */
function colour(name) {
  const probe = $("#theme");
  probe.style.color = `var(--${name})`;
  const value = getComputedStyle(probe).color;
  probe.style.color = "";
  return value;
}

/** What draws the elements of a selector whenever they come into sight, or light and dark change. */
const painters = new Map();

/** Draw what is in sight. */
function draw() {
  for (const [selector, paint] of painters) {
    for (const place of document.querySelectorAll(selector)) if (place.offsetParent) paint(place);
  }
}

const chosen = {};

/** Choose an option of all choices that are made together. */
function choose(choice, number) {
  chosen[choice] = number;
  for (const select of document.querySelectorAll(`select[data-choice="${choice}"]`)) select.value = String(number);
  document.querySelectorAll(`.option[data-choice="${choice}"]`).forEach((option, index) => option.toggleAttribute("data-hidden", index !== number));
}

document.addEventListener("change", ({ target }) => {
  if (!target.matches("select[data-choice]")) return;
  choose(target.dataset.choice, Number(target.value));
  draw();
});

document.addEventListener("click", ({ target }) => {
  const button = target.closest("[data-option]");
  if (!button) return;
  const { choice, option } = button.dataset;
  choose(choice, Number(option));
  show($(`.option[data-choice="${choice}"]`).closest('[role="tabpanel"]').id);
  window.scrollTo(0, 0);
  $(`select[data-choice="${choice}"]`).focus();
});

document.addEventListener("click", ({ target }) => {
  const button = target.closest("[data-panel]");
  if (!button) return;
  show(button.dataset.panel);
  window.scrollTo(0, 0);
  $(`#${button.dataset.panel}`).focus({ preventScroll: true });
});

/** Show the panel `id`; its name becomes part of the address, so that a link can point at it. */
function show(id) {
  openPanel(id);
  history.replaceState(null, "", `#${id}`);
}

/** Scroll the row `tabs` until `tab` is seen. scrollIntoView scrolls the page around a frame, too: a run's page of the
 * service began in the middle, at its report. */
function scrollWithin(tabs, tab) {
  const seen = tabs.getBoundingClientRect();
  const own = tab.getBoundingClientRect();
  tabs.scrollLeft += Math.min(own.left - seen.left, 0) || Math.max(own.right - seen.right, 0);
}

function openPanel(id) {
  for (const panel of document.querySelectorAll('[role="tabpanel"]')) panel.classList.toggle("shown", panel.id === id);
  for (const tab of document.querySelectorAll('[role="tab"]')) {
    const chosen = tab.getAttribute("aria-controls") === id;
    tab.setAttribute("aria-selected", String(chosen));
    tab.tabIndex = chosen ? 0 : -1;
    if (chosen) scrollWithin(tab.parentElement, tab);
  }
  draw();
}

/** All panels are printed, also those that nobody has looked at. */
addEventListener("beforeprint", () => {
  document.documentElement.classList.add("printed");
  draw();
});
addEventListener("afterprint", () => {
  document.documentElement.classList.remove("printed");
  draw();
});

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
  dark.addEventListener("change", draw);
  $("#theme").addEventListener("click", () => {
    const root = document.documentElement;
    const now = root.dataset.theme || (dark.matches ? "dark" : "light");
    root.dataset.theme = now === "dark" ? "light" : "dark";
    draw();
  });
  document.documentElement.classList.add("scripted");
  for (const select of document.querySelectorAll("select[data-choice]")) choose(select.dataset.choice, chosen[select.dataset.choice] ?? Number(select.value));
  const panels = tabs.map((tab) => tab.getAttribute("aria-controls"));
  openPanel(panels.find((id) => id === location.hash.slice(1)) || panels[0]);
}

document.addEventListener("DOMContentLoaded", startPage);
