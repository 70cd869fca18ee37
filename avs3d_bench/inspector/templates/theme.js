"use strict";
// The theme of the system, until the reader chooses another; the choice is stored if the browser allows it.
(() => {
  const root = document.documentElement;
  const system = window.matchMedia("(prefers-color-scheme: dark)");
  const stored = () => { try { return localStorage.getItem("avs3d-theme"); } catch { return null; } };
  const apply = (theme) => {
    if (theme === "dark" || theme === "light") root.dataset.theme = theme;
    window.dispatchEvent(new CustomEvent("avs3d:theme"));
  };
  root.classList.add("script");
  apply(stored());
  document.addEventListener("DOMContentLoaded", () => {
    const button = document.querySelector("[data-theme-toggle]");
    const dark = () => (root.dataset.theme ? root.dataset.theme === "dark" : system.matches);
    const show = () => {
      button.setAttribute("aria-pressed", String(dark()));
      button.textContent = dark() ? "Light" : "Dark";
      button.setAttribute("aria-label", dark() ? "Switch to light" : "Switch to dark");
    };
    button.addEventListener("click", () => {
      const theme = dark() ? "light" : "dark";
      try { localStorage.setItem("avs3d-theme", theme); } catch { /* not stored: valid for this page only */ }
      apply(theme);
      show();
    });
    system.addEventListener("change", () => { show(); window.dispatchEvent(new CustomEvent("avs3d:theme")); });
    show();
  });
})();
