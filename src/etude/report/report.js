// Reads values off a panel under the pointer, and opens folded parts for printing. The page is complete without it.
"use strict";
(() => {
  const readout = document.querySelector(".readout");
  const back = (pixel, low, high, start, end, log) => {
    const share = (pixel - start) / (end - start);
    return log ? low * Math.pow(high / low, share) : low + share * (high - low);
  };
  const show = (event) => {
    const svg = event.target.closest && event.target.closest("svg.panel");
    if (!svg) { readout.style.display = "none"; return; }
    const [xl, xh, xs, xe, yl, yh, ys, ye, xlog, ylog] = svg.dataset.scale.split(" ").map(Number);
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    if (point.x < xs || point.x > xe || point.y < ye || point.y > ys) { readout.style.display = "none"; return; }
    const text = (value) => Number(value.toPrecision(3)).toString();
    readout.textContent = text(back(point.x, xl, xh, xs, xe, xlog)) + " , " + text(back(point.y, yl, yh, ys, ye, ylog));
    readout.style.left = event.clientX + 14 + "px";
    readout.style.top = event.clientY + 14 + "px";
    readout.style.display = "block";
  };
  document.addEventListener("pointermove", show);
  window.addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => { d.open = true; }));
})();
