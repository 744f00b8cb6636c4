// Filters and search of the first page, and folded parts opened for print. Every page is complete without it.
"use strict";
(() => {
  window.addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => { d.open = true; }));
  const form = document.querySelector("form.filters");
  if (!form) return;
  form.hidden = false;
  const buttons = [...form.querySelectorAll("button[data-facet]")];
  const search = document.getElementById("search");
  const items = [...document.querySelectorAll("ul.claims > li, ul.entries > li")];
  const claims = [...document.querySelectorAll("ul.claims > li")];
  const count = document.getElementById("count");
  const words = new Map(items.map((item) => [item, item.textContent.toLowerCase()]));

  const chosen = () => {
    const found = new Map();
    for (const button of buttons) {
      if (button.getAttribute("aria-pressed") !== "true") continue;
      const { facet, value } = button.dataset;
      found.set(facet, [...(found.get(facet) || []), value]);
    }
    return found;
  };
  const fits = (item, wanted, text) =>
    text.split(/\s+/).every((word) => words.get(item).includes(word)) &&
    [...wanted].every(([facet, values]) => {
      const own = (item.getAttribute("data-" + facet) || "").split("|");
      return values.some((value) => own.includes(value));
    });
  const show = () => {
    const wanted = chosen();
    const text = search.value.trim().toLowerCase();
    for (const item of items) item.hidden = !fits(item, wanted, text);
    for (const part of document.querySelectorAll("section.chapter")) {
      part.hidden = !part.querySelector("ul.claims > li:not([hidden])");
    }
    const left = claims.filter((item) => !item.hidden).length;
    count.textContent = left === claims.length ? left + " claims" : left + " of " + claims.length + " claims";
    const state = [...wanted].map(([facet, values]) => facet + "=" + values.join("|")).join("&");
    history.replaceState(null, "", state ? "#" + encodeURI(state) : location.pathname + location.search);
  };
  const press = (button, on) => button.setAttribute("aria-pressed", on ? "true" : "false");
  const read = () => {
    const wanted = new Map(decodeURI(location.hash.slice(1)).split("&").map((one) => one.split("=")));
    if (![...wanted.values()].some(Boolean)) return;
    for (const button of buttons) {
      press(button, (wanted.get(button.dataset.facet) || "").split("|").includes(button.dataset.value));
    }
    show();
  };
  for (const button of buttons) {
    button.addEventListener("click", () => { press(button, button.getAttribute("aria-pressed") !== "true"); show(); });
  }
  document.getElementById("clear").addEventListener("click", () => {
    buttons.forEach((button) => press(button, false));
    search.value = "";
    show();
  });
  search.addEventListener("input", show);
  form.addEventListener("submit", (event) => event.preventDefault());
  window.addEventListener("hashchange", read);
  read();
})();
