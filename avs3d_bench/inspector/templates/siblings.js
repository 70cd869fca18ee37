"use strict";
// Siblings of a group: the same pictures, another sound. A click changes sound and truth; the picture stays.
window.AVS3D = window.AVS3D ?? {};
(() => {
  const known = new Map();
  const waiting = new Map();

  // Called by the script <sibling>/scene.js.
  window.AVS3D.sibling = (payload) => {
    known.set(payload.data.key, payload);
    waiting.get(payload.data.key)?.(payload);
  };

  const fetched = (folder, key) => {
    if (known.has(key)) return Promise.resolve(known.get(key));
    return new Promise((done, fail) => {
      const script = document.createElement("script");
      waiting.set(key, (payload) => { waiting.delete(key); script.remove(); done(payload); });
      script.addEventListener("error", () => { waiting.delete(key); script.remove(); fail(new Error(key)); });
      script.src = new URL("scene.js", folder).href;
      document.head.append(script);
    });
  };

  class Siblings {
    // `swap(payload, folder)` shows another observation; it returns false if the picture could not stay.
    constructor(nav, home, swap) {
      Object.assign(this, { nav, swap, wanted: null });
      this.links = [...nav.querySelectorAll("a[data-key]")];
      // Resolved now: after a change, the page's address may be another.
      for (const link of this.links) link.href = new URL(link.getAttribute("href"), home).href;
      nav.addEventListener("click", (event) => {
        const link = event.target.closest("a[data-key]");
        if (!link || event.button || event.ctrlKey || event.metaKey || event.shiftKey || event.altKey) return;
        event.preventDefault();
        this.go(link);
      });
      // The data is on its way before the click.
      for (const kind of ["pointerenter", "focusin"]) for (const link of this.links) link.addEventListener(kind, () => { this.load(link).catch(() => null); }, { once: true });
    }

    get current() { return this.links.findIndex((link) => link.getAttribute("aria-current")); }

    load(link) { return fetched(new URL(".", link.href), link.dataset.key); }

    beside(by) { return this.links[(this.current + by + this.links.length) % this.links.length]; }

    async step(by) {
      await this.go(this.beside(by));
      this.load(this.beside(by)).catch(() => null); // perhaps the next to be asked for
    }

    async go(link) {
      if (link.getAttribute("aria-current")) return;
      this.wanted = link;
      this.nav.setAttribute("aria-busy", "true");
      let shown = false;
      try {
        const payload = await this.load(link);
        if (this.wanted !== link) return;
        shown = this.swap(payload, new URL(".", link.href));
      } catch { /* its page says why */ }
      this.nav.removeAttribute("aria-busy");
      if (!shown) { location.href = `${link.href}${location.hash}`; return; }
      for (const each of this.links) each.toggleAttribute("aria-current", false);
      link.setAttribute("aria-current", "page");
      // A reload shows this sibling; pages from disk may not change their address.
      try { history.replaceState(null, "", `${link.href}${location.hash}`); } catch { /* opened from disk */ }
    }
  }
  window.AVS3D.Siblings = Siblings;
})();
