"use strict";
// Filters of the gallery. Their state is in the URL's hash, so that a view can be shared and "back" undoes a choice.
(() => {
  const form = document.getElementById("filters");
  const cards = [...document.querySelectorAll("#gallery > li")];
  const boxes = [...form.querySelectorAll("input[type=checkbox]")];
  const text = form.elements.q;
  const facets = [...form.querySelectorAll("[data-facet]")].map((set) => set.dataset.facet);
  const none = document.getElementById("none");
  const clear = form.querySelector("[type=reset]");
  const words = cards.map((card) => card.dataset.text.toLowerCase());

  const chosen = () => Object.fromEntries(facets.map((facet) => [
    facet, new Set(boxes.filter((box) => box.name === facet && box.checked).map((box) => box.value)),
  ]));
  const wanted = () => text.value.toLowerCase().split(/\s+/).filter(Boolean);

  // A card has one value of a facet, or several (the sources of a part_3 observation), separated by spaces.
  const values = cards.map((card) => Object.fromEntries(facets.map((facet) => [facet, (card.dataset[facet] ?? "\u0000").split(" ")])));

  // Whether a card passes all filters, except that of the facet `except`.
  const passes = (at, picks, terms, except) =>
    facets.every((facet) => facet === except || !picks[facet].size || values[at][facet].some((value) => picks[facet].has(value)))
    && terms.every((term) => words[at].includes(term));

  const apply = () => {
    const picks = chosen(), terms = wanted();
    let shown = 0;
    cards.forEach((card, at) => {
      card.hidden = !passes(at, picks, terms, null);
      shown += !card.hidden;
    });
    for (const box of boxes) {
      const count = cards.filter((_, at) =>
        values[at][box.name].includes(box.value) && passes(at, picks, terms, box.name)).length;
      box.parentElement.querySelector("small").textContent = count;
      box.parentElement.classList.toggle("empty", count === 0 && !box.checked);
    }
    document.getElementById("count").textContent = `${shown} of ${cards.length}`;
    none.hidden = shown > 0;
    clear.hidden = !terms.length && !boxes.some((box) => box.checked);
  };

  const hash = () => {
    const query = new URLSearchParams();
    for (const [facet, values] of Object.entries(chosen())) if (values.size) query.set(facet, [...values].join(","));
    if (text.value.trim()) query.set("q", text.value.trim());
    return query.toString().replaceAll("%2C", ",");
  };
  const read = () => {
    if (location.hash === "#main") return; // the link "Skip to the content"
    const query = new URLSearchParams(location.hash.slice(1));
    for (const box of boxes) box.checked = (query.get(box.name) ?? "\u0000").split(",").includes(box.value);
    text.value = query.get("q") ?? "";
    apply();
  };
  const write = (method) => {
    const next = hash();
    history[method](null, "", next ? `#${next}` : location.pathname + location.search);
    apply();
  };

  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("change", (event) => { if (event.target !== text) write("pushState"); });
  text.addEventListener("input", () => write("replaceState"));
  form.addEventListener("reset", (event) => {
    event.preventDefault();
    for (const box of boxes) box.checked = false;
    text.value = "";
    write("pushState");
    text.focus();
  });
  document.querySelector("[data-clear]").addEventListener("click", () => form.reset());
  window.addEventListener("popstate", read);
  window.addEventListener("hashchange", read);
  window.addEventListener("keydown", (event) => {
    if (event.key === "/" && event.target !== text) { event.preventDefault(); text.focus(); }
  });
  read();
})();
