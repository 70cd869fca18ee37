"use strict";
// Theme, sorting, filtering and switches. The page can be read without any of them.
(() => {
  const root = document.documentElement;
  root.classList.add("script");
  const stored = () => { try { return localStorage.getItem("avs3d-theme"); } catch { return null; } };
  const store = (value) => { try { localStorage.setItem("avs3d-theme", value); } catch { /* not allowed here */ } };
  if (["light", "dark"].includes(stored())) root.dataset.theme = stored();

  const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches);

  function themeToggle(button) {
    const show = () => {
      button.textContent = isDark() ? "Light" : "Dark";
      button.setAttribute("aria-label", `Switch to the ${isDark() ? "light" : "dark"} theme`);
      button.setAttribute("aria-pressed", String(isDark()));
    };
    button.addEventListener("click", () => {
      root.dataset.theme = isDark() ? "light" : "dark";
      store(root.dataset.theme);
      show();
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
    show();
  }

  const collator = new Intl.Collator("en", { numeric: true, sensitivity: "base" });
  const text = (cell) => cell.dataset.v ?? cell.textContent.trim();

  /** Sort the rows of every tbody by one column; missing values are last, equal values keep the order of the page. */
  function sortBy(table, heading, direction) {
    const column = [...heading.parentElement.children].indexOf(heading);
    const numeric = heading.classList.contains("number");
    const sign = direction === "ascending" ? 1 : -1;
    for (const body of table.tBodies) {
      const rows = [...body.rows].filter((row) => !row.dataset.fixed).map((row) => {
        const value = text(row.cells[column]);
        return { row, value: value === "" ? null : numeric ? Number(value) : value, order: Number(row.dataset.order) };
      });
      rows.sort((a, b) => {
        if (a.value === null || b.value === null) return (a.value === null) - (b.value === null) || a.order - b.order;
        const way = numeric ? a.value - b.value : collator.compare(a.value, b.value);
        return sign * way || a.order - b.order;
      });
      body.append(...rows.map((item) => item.row));
    }
    for (const other of heading.parentElement.children) other.setAttribute("aria-sort", other === heading ? direction : "none");
    if (heading.dataset.rank) rankBy(table, heading, column);
  }

  /** Write ranks for one figure: those of the tests, else equal values share one; rows without a rank keep their dash. */
  function rankBy(table, heading, column) {
    const sign = heading.dataset.rank === "ascending" ? 1 : -1;
    const rows = [...table.querySelectorAll("tr[data-ranked]")];
    const values = rows.map((row) => text(row.cells[column])).map((value) => (value === "" ? null : Number(value)));
    rows.forEach((row, index) => {
      const mine = values[index];
      const place = row.cells[column].dataset.place;
      const rank = mine === null ? null : place ? Number(place) : 1 + values.filter((other) => other !== null && sign * (other - mine) < 0).length;
      row.cells[0].textContent = rank === null ? "–" : String(rank);
      row.cells[0].dataset.v = rank === null ? "" : String(rank);
    });
    const named = table.parentElement.previousElementSibling?.querySelector("[data-ranked-by]");
    if (named) named.textContent = heading.textContent.trim();
    for (const other of heading.parentElement.children) other.classList.toggle("ranks", other === heading);
  }

  function sortable(table) {
    for (const body of table.tBodies) [...body.rows].forEach((row, index) => { row.dataset.order = index; });
    for (const heading of table.tHead.rows[table.tHead.rows.length - 1].cells) {
      const button = heading.querySelector("button");
      if (!button) continue;
      button.addEventListener("click", () => {
        const now = heading.getAttribute("aria-sort");
        const next = now === "none" ? button.dataset.first : now === "ascending" ? "descending" : "ascending";
        sortBy(table, heading, next);
      });
    }
  }

  /** Show the rows that contain every word of the filter's text. */
  function filterBox(input) {
    const count = document.querySelector(`[data-count="${input.dataset.filter}"]`);
    const tables = [...document.querySelectorAll(`[data-filterable="${input.dataset.filter}"]`)];
    const rows = tables.flatMap((table) => [...table.tBodies]).flatMap((body) => [...body.rows]).filter((row) => !row.dataset.fixed);
    const words = (row) => [...row.querySelectorAll(".text")].map((cell) => `${cell.textContent} ${cell.dataset.v ?? ""}`).join(" ").toLowerCase();
    const haystack = new Map(rows.map((row) => [row, words(row)]));
    const apply = () => {
      const wanted = input.value.toLowerCase().split(/\s+/).filter(Boolean);
      let shown = 0;
      for (const row of rows) {
        row.hidden = !wanted.every((word) => haystack.get(row).includes(word));
        shown += !row.hidden;
      }
      if (count) count.textContent = `${shown} of ${rows.length}`;
    };
    input.addEventListener("input", apply);
    apply();
  }

  /** Radio groups select which elements, by their data attributes, are shown. */
  function switches() {
    const radios = [...document.querySelectorAll(".switch input")];
    const names = [...new Set(radios.map((radio) => radio.name))];
    const apply = () => {
      const state = Object.fromEntries(names.map((name) => [name, radios.find((r) => r.name === name && r.checked)?.value]));
      for (const name of names) {
        for (const element of document.querySelectorAll(`[data-${name}]`)) {
          element.hidden = names.some((other) => element.dataset[other] !== undefined && element.dataset[other] !== state[other]);
        }
      }
    };
    for (const radio of radios) radio.addEventListener("change", apply);
    if (radios.length) apply();
  }

  document.addEventListener("DOMContentLoaded", () => {
    document.querySelectorAll("[data-theme-toggle]").forEach(themeToggle);
    document.querySelectorAll("table.sortable").forEach(sortable);
    document.querySelectorAll("[data-filter]").forEach(filterBox);
    switches();
  });
})();
