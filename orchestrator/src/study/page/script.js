"use strict";
document.body.classList.add("js");

/** Returns a cell's number if it has one, otherwise its text. */
const valueOf = (row, column) => {
  const cell = row.cells[column];
  const text = cell.dataset.value ?? cell.textContent.trim();
  const number = Number.parseFloat(text.replace("−", "-"));
  return Number.isNaN(number) ? text : number;
};

// On a phone, every row is a block of lines: the head of a column, and its cell.
for (const table of document.querySelectorAll("table:not(.heat)")) {
  const heads = [...(table.tHead?.rows[0].cells ?? [])].map((head) => head.textContent);
  for (const row of table.tBodies[0].rows) heads.forEach((head, column) => (row.cells[column].dataset.head = head));
}

for (const head of document.querySelectorAll("th[data-sort]")) {
  head.addEventListener("click", () => {
    const body = head.closest("table").tBodies[0];
    const column = head.cellIndex;
    const sign = head.dataset.order === "up" ? -1 : 1;
    head.dataset.order = sign === 1 ? "up" : "down";
    const rows = [...body.rows].sort((a, b) => {
      const [x, y] = [valueOf(a, column), valueOf(b, column)];
      if (typeof x === typeof y) return sign * (typeof x === "number" ? x - y : x.localeCompare(y));
      return typeof x === "number" ? -1 : 1;
    });
    body.append(...rows);
  });
}

for (const input of document.querySelectorAll("input[data-filter]")) {
  const rows = document.getElementById(input.dataset.filter).tBodies[0].rows;
  input.addEventListener("input", () => {
    const wanted = input.value.trim().toLowerCase();
    for (const row of rows) row.hidden = !row.textContent.toLowerCase().includes(wanted);
  });
}

for (const table of document.querySelectorAll("table.heat")) {
  const details = table.closest("section").querySelector(".hover");
  table.addEventListener("mouseover", (event) => {
    if (event.target.title) details.textContent = event.target.title;
  });
}
