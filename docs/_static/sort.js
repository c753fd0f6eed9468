// Tables with more than six columns can be sorted by a click on the head of a column.
"use strict";

/** The first number in a cell, or its text in lower case. */
function sortKey(row, column) {
  const text = row.cells[column].textContent.trim();
  const number = text.match(/-?\d+(\.\d+)?/);
  return number && !/[a-z]/i.test(text.slice(0, number.index)) ? Number(number[0]) : text.toLowerCase();
}

function compare(first, second) {
  if (typeof first === typeof second) return first < second ? -1 : first > second ? 1 : 0;
  return typeof first === "number" ? -1 : 1;
}

function sortBy(table, column) {
  const heads = [...table.tHead.rows[0].cells];
  const ascending = heads[column].getAttribute("aria-sort") !== "ascending";
  const rows = [...table.tBodies[0].rows].sort(
    (one, other) => (ascending ? 1 : -1) * compare(sortKey(one, column), sortKey(other, column))
  );
  heads.forEach((head) => head.removeAttribute("aria-sort"));
  heads[column].setAttribute("aria-sort", ascending ? "ascending" : "descending");
  table.tBodies[0].append(...rows);
}

document.addEventListener("DOMContentLoaded", () => {
  for (const table of document.querySelectorAll("table")) {
    if (!(table.tHead?.rows[0].cells.length > 6 && table.tBodies[0]?.rows.length > 1)) continue;
    table.classList.add("sortable");
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      const button = document.createElement("button");
      button.className = "sort";
      button.append(...head.childNodes);
      button.addEventListener("click", () => sortBy(table, column));
      head.append(button);
    });
  }
});
