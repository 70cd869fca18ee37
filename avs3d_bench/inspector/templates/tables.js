"use strict";
// On a phone, every row of a table is a block, and every cell has the heading of its column (tables.css): no column is
// cut off. Roles are written out, because elements that are no table cells for the eye lose them.
(() => {
  const heading = (cell) => cell.dataset.short ?? (cell.querySelector("button") ?? cell).textContent.trim().replace(/\s+/g, " ");
  const role = (table, selector, name) => table.querySelectorAll(selector).forEach((element) => element.setAttribute("role", name));
  const label = (table) => {
    const last = table.tHead?.rows[table.tHead.rows.length - 1];
    if (!last || table.classList.contains("stacks")) return;
    const names = [...last.cells].flatMap((cell) => Array(cell.colSpan).fill(heading(cell)));
    for (const body of table.tBodies) for (const row of body.rows) {
      let column = 0;
      for (const cell of row.cells) {
        if (cell.colSpan === 1 && names[column]) cell.dataset.label = names[column];
        column += cell.colSpan;
      }
    }
    table.setAttribute("role", "table");
    for (const [selector, name] of [["thead, tbody", "rowgroup"], ["tr", "row"], ["thead th", "columnheader"], ["tbody th", "rowheader"], ["td", "cell"]]) role(table, selector, name);
    table.classList.add("stacks");
  };
  const all = () => document.querySelectorAll("table").forEach(label);
  document.addEventListener("DOMContentLoaded", all);
  window.addEventListener("avs3d:tables", all); // some were added
})();
