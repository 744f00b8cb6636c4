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
  // a figure of sticks: plays at its own speed while it is in sight, and stands where less motion is asked for
  const less = window.matchMedia("(prefers-reduced-motion: reduce)");
  document.querySelectorAll(".stage").forEach((stage) => {
    const { step, sticks, carried, pixels } = JSON.parse(stage.dataset.motion);
    const [button, range, output] = ["button", "input", "output"].map((what) => stage.querySelector(what));
    const [limb, ...held] = stage.querySelectorAll(".robot path");
    const end = Number(range.max);
    const width = Math.round(pixels.length / (Math.round(end / step) + 1));
    let time = 0, playing = false, inSight = false, last = null;
    const draw = () => {
      const frame = Math.min(Math.floor(time / step), pixels.length / width - 2);
      const share = Math.min(time / step - frame, 1);
      const number = (i) => (0.1 * (pixels[frame * width + i] * (1 - share) + pixels[(frame + 1) * width + i] * share)).toFixed(1);
      const at = (point) => number(2 * point) + " " + number(2 * point + 1);
      limb.setAttribute("d", sticks.map((point, k) => (k % 2 ? "L" : "M") + at(point)).join(""));
      held.forEach((path, k) => path.setAttribute("d", carried[k].map((face) => "M" + face.map(at).join("L") + "Z").join("")));
      range.value = time;
      output.textContent = time.toFixed(1) + " s";
    };
    const tick = (now) => {
      if (!playing || !inSight) { last = null; return; }
      if (last !== null) { time = (time + (now - last) / 1000) % end; }
      last = now;
      draw();
      requestAnimationFrame(tick);
    };
    const play = (on) => {
      playing = on;
      button.textContent = on ? "Pause" : "Play";
      if (on && last === null) { requestAnimationFrame(tick); }
    };
    button.addEventListener("click", () => play(!playing));
    range.addEventListener("input", () => { play(false); time = Number(range.value); draw(); });
    stage.querySelector(".transport").hidden = false;
    new IntersectionObserver(([entry]) => {
      inSight = entry.isIntersecting;
      if (inSight && playing) { requestAnimationFrame(tick); }
    }).observe(stage);
    play(!less.matches);
  });
  window.addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => { d.open = true; }));
})();
