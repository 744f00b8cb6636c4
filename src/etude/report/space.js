// A robot in space: solid parts along a motion, what stands around it, and how near both come. WebGL 2 alone.
"use strict";
(() => {
  const VERTEX = `#version 300 es
    in vec3 point; in vec4 x, y, z, tint;
    uniform mat4 camera; out vec3 place; out vec4 colour;
    void main() {
      vec4 p = vec4(point, 1.0);
      place = vec3(dot(x, p), dot(y, p), dot(z, p)); colour = tint; gl_Position = camera * vec4(place, 1.0);
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    in vec3 place; in vec4 colour; uniform vec3 eye; uniform bool lit; out vec4 shown;
    void main() {
      vec3 to = normalize(eye - place), n = normalize(cross(dFdx(place), dFdy(place)));
      n = dot(n, to) < 0.0 ? -n : n;
      float light = lit ? 0.45 + 0.3 * dot(n, to) + 0.35 * max(dot(n, normalize(vec3(0.3, -0.5, 0.9))), 0.0) : 1.0;
      shown = vec4(colour.rgb * light, colour.a);
    }`;
  const FIELD = 0.6, NEAR_MM = 30, FAR_MM = 100, COPIES = 90, SLOW_MS = 150;  // rad; mm between red and plain; poses of what is swept; between two pictures
  const GREEN = [0.16, 0.62, 0.45], AMBER = [0.93, 0.62, 0.0], RED = [0.83, 0.13, 0.13], GHOST = [0.1, 0.45, 0.85];
  const INK = { solid: [0.9, 0.62, 0.0], plane: [0.5, 0.53, 0.57], inside: [0.45, 0.48, 0.52], stand: [0.45, 0.48, 0.52] };

  const decoded = (text, type) => new type(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const mixed = (a, b, share) => a.map((value, i) => value + (b[i] - value) * share);
  const sub = (a, b) => a.map((value, i) => value - b[i]);
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => a.map((value) => value / (Math.hypot(...a) || 1));
  const coloured = (mm, plain) => {  // by what is left beyond what is kept
    if (mm >= FAR_MM) { return plain; }
    return mm > NEAR_MM ? mixed(AMBER, plain, (mm - NEAR_MM) / (FAR_MM - NEAR_MM)) : mixed(RED, AMBER, Math.max(mm, 0) / NEAR_MM);
  };
  const css = (colour) => `rgb(${colour.map((value) => Math.round(255 * value)).join(" ")})`;
  const framed = (out, at, place, quaternion) => {  // three rows of rotation and place
    const [w, x, y, z] = quaternion;
    const s = 2 / (w * w + x * x + y * y + z * z);
    out.set([1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y), place[0],
      s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x), place[1],
      s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y), place[2]], at);
  };
  const stretched = (from, to, width) => {  // rows that lay the unit box between two points
    const along = sub(to, from);
    const u = unit(cross(along, Math.abs(along[2]) > 0.9 * Math.hypot(...along) ? [1, 0, 0] : [0, 0, 1]));
    const v = unit(cross(along, u));
    return [0, 1, 2].flatMap((i) => [u[i] * width, v[i] * width, along[i], from[i]]);
  };

  // what draws: meshes in instances, each 3 rows of a frame and a colour
  const renderer = (canvas) => {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
    if (!gl) { return null; }
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    gl.useProgram(program);
    const uniform = (name) => gl.getUniformLocation(program, name);
    const [camera, eye, lit] = ["camera", "eye", "lit"].map(uniform);
    const mesh = (points, faces) => {
      const own = { array: gl.createVertexArray(), count: faces.length, instances: gl.createBuffer() };
      gl.bindVertexArray(own.array);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(points), gl.STATIC_DRAW);
      const place = gl.getAttribLocation(program, "point");
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(faces), gl.STATIC_DRAW);
      gl.bindBuffer(gl.ARRAY_BUFFER, own.instances);
      ["x", "y", "z", "tint"].forEach((name, k) => {
        const at = gl.getAttribLocation(program, name);
        gl.enableVertexAttribArray(at);
        gl.vertexAttribPointer(at, 4, gl.FLOAT, false, 64, 16 * k);
        gl.vertexAttribDivisor(at, 1);
      });
      return own;
    };
    const draw = (own, instances) => {
      if (!instances.length) { return; }
      gl.bindVertexArray(own.array);
      gl.bindBuffer(gl.ARRAY_BUFFER, own.instances);
      gl.bufferData(gl.ARRAY_BUFFER, instances, gl.DYNAMIC_DRAW);
      gl.drawElementsInstanced(gl.TRIANGLES, own.count, gl.UNSIGNED_INT, 0, instances.length / 16);
    };
    // only what is nearest to the eye of all of it: the outside of a union, however often its parts overlap
    const skin = (drawn) => {
      gl.colorMask(false, false, false, false);
      drawn();
      gl.colorMask(true, true, true, true);
      gl.enable(gl.BLEND);
      drawn();
      gl.disable(gl.BLEND);
    };
    const pale = (drawn) => {  // hides nothing
      gl.depthMask(false);
      gl.enable(gl.BLEND);
      drawn();
      gl.disable(gl.BLEND);
      gl.depthMask(true);
    };
    const begin = (view, from, paper) => {
      const [width, height] = ["clientWidth", "clientHeight"].map((side) => Math.round(canvas[side] * Math.min(devicePixelRatio, 2)));
      if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
      gl.viewport(0, 0, width, height);
      gl.clearColor(...paper, 1);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.enable(gl.DEPTH_TEST);
      gl.depthFunc(gl.LEQUAL);
      gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE);
      gl.uniformMatrix4fv(camera, false, view);
      gl.uniform3fv(eye, from);
    };
    return { mesh, draw, skin, pale, begin, lit: (on) => gl.uniform1i(lit, on) };
  };

  // where the eye is, and the pointers and keys that move it
  const orbit = (canvas, start, changed) => {
    const own = { ...start, target: [...start.target] };
    const pointers = new Map();
    const basis = () => {
      const [ca, sa, ce, se] = [Math.cos(own.azimuth), Math.sin(own.azimuth), Math.cos(own.elevation), Math.sin(own.elevation)];
      return { right: [-sa, ca, 0], up: [-se * ca, -se * sa, ce], back: [ce * ca, ce * sa, se] };
    };
    const turn = (dx, dy) => {
      own.azimuth -= 0.008 * dx;
      own.elevation = Math.min(Math.max(own.elevation + 0.008 * dy, -1.5), 1.5);
    };
    const move = (dx, dy) => {
      const { right, up } = basis(), step = 2 * Math.tan(FIELD / 2) * own.distance / canvas.clientHeight;
      own.target = own.target.map((value, i) => value - step * (dx * right[i] - dy * up[i]));
    };
    const zoom = (factor) => { own.distance = Math.min(Math.max(own.distance * factor, 0.05 * start.distance), 8 * start.distance); };
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); pointers.set(event.pointerId, [event.clientX, event.clientY]); });
    canvas.addEventListener("pointermove", (event) => {
      const last = pointers.get(event.pointerId);
      if (!last) { return; }
      const [dx, dy] = [event.clientX - last[0], event.clientY - last[1]];
      const other = [...pointers].find(([id]) => id !== event.pointerId);
      if (other) {  // two fingers
        const far = (x, y) => Math.hypot(x - other[1][0], y - other[1][1]) || 1;
        zoom(far(...last) / far(event.clientX, event.clientY));
        move(dx / 2, dy / 2);
      } else if (event.buttons & 2 || event.shiftKey) { move(dx, dy); } else { turn(dx, dy); }
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
      changed();
    });
    for (const name of ["pointerup", "pointercancel"]) { canvas.addEventListener(name, (event) => pointers.delete(event.pointerId)); }
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(0.001 * event.deltaY)); changed(); }, { passive: false });
    canvas.addEventListener("dblclick", () => { Object.assign(own, start, { target: [...start.target] }); changed(); });
    const keys = { ArrowLeft: () => turn(-20, 0), ArrowRight: () => turn(20, 0), ArrowUp: () => turn(0, 20), ArrowDown: () => turn(0, -20), "+": () => zoom(0.9), "-": () => zoom(1.1) };
    canvas.addEventListener("keydown", (event) => { if (keys[event.key]) { event.preventDefault(); keys[event.key](); changed(); } });
    const view = () => {
      const { right, up, back } = basis();
      const aspect = canvas.clientWidth / canvas.clientHeight;
      const far = own.distance / Math.min(1, aspect);  // a narrow window sees the whole width too
      const eye = own.target.map((value, i) => value + far * back[i]);
      const f = 1 / Math.tan(FIELD / 2), near = 0.02 * far, end = 20 * far;
      const rows = [right, up, back].map((axis) => [...axis, -dot(axis, eye)]);
      const [a, b] = [(end + near) / (near - end), 2 * end * near / (near - end)];
      const matrix = [0, 1, 2, 3].flatMap((i) => [f / aspect * rows[0][i], f * rows[1][i], a * rows[2][i] + (i === 3 ? b : 0), -rows[2][i]]);
      const pixel = (p) => {
        const [x, y, , w] = [0, 1, 2, 3].map((k) => matrix[k] * p[0] + matrix[4 + k] * p[1] + matrix[8 + k] * p[2] + matrix[12 + k]);
        return w > 0 ? [(0.5 + 0.5 * x / w) * canvas.clientWidth, (0.5 - 0.5 * y / w) * canvas.clientHeight] : null;
      };
      return { matrix: new Float32Array(matrix), eye, pixel };
    };
    return { view, own };
  };

  const opened = (figure) => {
    const data = JSON.parse(figure.querySelector("script").textContent);
    const canvas = figure.querySelector("canvas.view");
    const draws = renderer(canvas);
    if (!draws) { figure.querySelector(".no-view").hidden = false; return; }
    const part = (name) => figure.querySelector(name);
    const [room, lines] = [decoded(data.room, Uint16Array), decoded(data.lines, Int16Array)];
    const bodies = data.bodies.map((one) => ({ ...one, mesh: draws.mesh([...decoded(one.points, Int16Array)].map((v) => v * one.unit), decoded(one.faces, Uint16Array)) }));
    const B = bodies.length, last = data.count - 1, L = data.lines_each, J = data.joints.length;
    const box = draws.mesh([[-.5, -.5, 0], [.5, -.5, 0], [.5, .5, 0], [-.5, .5, 0], [-.5, -.5, 1], [.5, -.5, 1], [.5, .5, 1], [-.5, .5, 1]].flat(),
      [0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7, 0, 1, 5, 0, 5, 4, 1, 2, 6, 1, 6, 5, 2, 3, 7, 2, 7, 6, 3, 0, 4, 3, 4, 7]);
    const things = data.things.map((one) => ({ ...one, mesh: draws.mesh(one.points.flat(), one.faces.flatMap((face) => face.slice(2).flatMap((_, k) => [face[0], face[k + 1], face[k + 2]]))) }));
    const still = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];
    const thin = 0.0016 * data.size, less = window.matchMedia("(prefers-reduced-motion: reduce)");
    let time = 0, playing = false, tick = null, live = null, inSight = true, slow = false;

    const theme = () => {
      const dark = window.matchMedia("(prefers-color-scheme: dark)").matches;
      return dark ? { paper: [0.078, 0.09, 0.102], plain: [0.62, 0.67, 0.74], faint: [0.25, 0.28, 0.32] } : { paper: [1, 1, 1], plain: [0.52, 0.57, 0.65], faint: [0.8, 0.82, 0.85] };
    };
    const at = (own, target, frames) => {  // frames of all parts at a time, between two of those that are known
      const k = Math.min(Math.floor(own / data.step), last - 1), share = Math.min(Math.max(own / data.step - k, 0), 1);
      for (let b = 0; b < B; b++) {
        const [one, two] = [7 * (k * B + b), 7 * ((k + 1) * B + b)];
        const place = [0, 1, 2].map((i) => data.unit * (frames[one + i] + share * (frames[two + i] - frames[one + i])));
        const [p, n] = [frames.subarray(one + 3, one + 7), frames.subarray(two + 3, two + 7)];
        const sign = p[0] * n[0] + p[1] * n[1] + p[2] * n[2] + p[3] * n[3] < 0 ? -1 : 1;
        framed(target, 12 * b, place, [...p].map((value, i) => value + share * (sign * n[i] - value)));
      }
      return target;
    };
    const now = new Float32Array(12 * B);
    const ends = (own, points) => {  // of the sticks of a robot without parts, likewise
      const k = Math.min(Math.floor(own / data.step), last - 1), share = own / data.step - k, P = points.length / data.count;
      return Array.from({ length: P }, (_, i) => data.unit * (points[k * P + i] * (1 - share) + points[(k + 1) * P + i] * share));
    };
    const limbs = (places, colour) => data.sticks.flatMap((pair) => [...stretched(...pair.map((end) => places.slice(3 * end, 3 * end + 3)), 0.03 * data.size), ...colour]);
    const unpacked = (own) => own && { ...own, frames: decoded(own.frames, Int16Array), points: decoded(own.points, Int16Array), q: decoded(own.q, Float32Array) };
    const [planned, replay] = [data.planned, data.measured].map(unpacked);
    const real = () => {  // where the robot is, or was at this time
      if (live || !replay || time < replay.from || time > replay.to) { return live; }
      const k = nearest(time);
      return { frame: at(time, new Float32Array(12 * B), replay.frames), points: ends(time, replay.points), q: replay.q.subarray(k * J, k * J + J) };
    };
    const elsewhere = () => live?.elsewhere;  // it moves, but not along this motion in its time: no distance of it counts
    const nearest = (own) => Math.min(Math.max(Math.round(own / data.step), 0), last);
    const left = (k, b) => room[k * B + b];  // mm, beyond what is kept
    const narrow = (k) => [...Array(L).keys()].map((i) => {
      const [row, distance, ...ends] = lines.subarray(8 * (k * L + i), 8 * (k * L + i) + 8);
      return row < 0 ? null : { ...data.rows[row], mm: 0.1 * distance, spare: 0.1 * distance - data.rows[row].kept, ends: [0, 3].map((j) => ends.slice(j, j + 3).map((v) => v * data.unit)) };
    }).filter((one) => one);

    const fixed = () => {  // instances that no time changes
      const { plain, faint } = theme(), swept = bodies.map(() => []), skin = [], path = [];
      for (let c = 0; c < COPIES; c++) {
        const k = Math.round(c * last / (COPIES - 1));
        skin.push(...limbs(ends(k * data.step, planned.points), [...mixed(plain, [0, 0.45, 0.7], 0.5), 0.3]));
        const frame = at(k * data.step, new Float32Array(12 * B), planned.frames);
        bodies.forEach((one, b) => { if (one.moves) { swept[b].push(...frame.subarray(12 * b, 12 * b + 12), ...coloured(left(k, b), mixed(plain, [0, 0.45, 0.7], 0.5)), 0.3); } });
      }
      for (const tip of data.tips.map((text) => decoded(text, Int16Array))) {
        const point = (k) => [...tip.subarray(3 * k, 3 * k + 3)].map((v) => v * data.unit);
        const every = Math.max(1, Math.round(last / 1500));
        for (let k = every; k <= last; k += every) { path.push(...stretched(point(k - every), point(k), 1.5 * thin), 0.0, 0.45, 0.7, 1); }
      }
      const edges = things.flatMap((one) => one.edges.flatMap(([a, b]) => [...stretched(a, b, one.kind === "solid" ? 1.5 * thin : thin), ...(one.kind === "plane" ? faint : INK[one.kind]), 1]));
      return { swept: swept.map((own) => new Float32Array(own)), skin: new Float32Array(skin), path: new Float32Array(path), edges: new Float32Array(edges) };
    };
    let kept = fixed();

    const wanted = (name) => part(`[name=${name}]`)?.checked;
    const robot = (frame, colour, alpha) => bodies.forEach((one, b) => draws.draw(one.mesh, new Float32Array([...frame.subarray(12 * b, 12 * b + 12), ...colour(b), alpha])));
    const paint = () => {
      const { paper, plain } = theme(), k = nearest(time), view = eye.view(), near = elsewhere() ? [] : narrow(k), ghost = real();
      if (live?.asked) { now.set(live.asked.frame); } else { at(time, now, planned.frames); }
      draws.begin(view.matrix, view.eye, paper);
      draws.lit(false);
      draws.draw(box, kept.edges);
      if (wanted("path")) { draws.draw(box, kept.path); }
      if (wanted("distances")) { draws.draw(box, new Float32Array(near.flatMap((one) => [...stretched(...one.ends, 3 * thin), ...coloured(one.spare, GREEN), 1]))); }
      draws.lit(true);
      robot(now, (b) => elsewhere() ? plain : coloured(left(k, b), plain), 1);
      draws.draw(box, new Float32Array(limbs(live?.asked ? live.asked.points : ends(time, planned.points), [...plain, 1])));
      if (ghost) { draws.skin(() => { robot(ghost.frame, () => GHOST, 0.55); draws.draw(box, new Float32Array(limbs(ghost.points, [...GHOST, 0.55]))); }); }
      draws.pale(() => things.filter((one) => one.faces.length && one.kind !== "inside").forEach((one) => draws.draw(one.mesh, new Float32Array([...still, ...INK[one.kind], one.kind === "plane" ? 0.1 : 0.3]))));
      if (wanted("swept") && !(slow && playing)) { draws.skin(() => { bodies.forEach((one, b) => draws.draw(one.mesh, kept.swept[b])); draws.draw(box, kept.skin); }); }
      label(view, near, k, ghost);
    };

    const labels = part(".labels"), tags = new Map();
    let written = [];  // of this picture, so that no name lies on another
    const tag = (key, words, pixel, style) => {
      if (!tags.has(key)) { tags.set(key, labels.appendChild(document.createElement("span"))); }
      const own = tags.get(key);
      own.hidden = !pixel;
      if (!pixel) { return; }
      own.textContent = words;
      own.className = style || "";
      const half = 3.6 * words.length + 8;
      const x = Math.min(Math.max(pixel[0], half), canvas.clientWidth - half);
      let y = Math.min(Math.max(pixel[1], 26), canvas.clientHeight - 24);
      while (written.some(([a, b, other]) => Math.abs(a - x) < half + other && Math.abs(b - y) < 20)) { y -= 5; }
      written.push([x, y, half]);
      own.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -130%)`;
    };
    const middle = (a, b) => a.map((value, i) => 0.5 * (value + b[i]));
    const label = (view, near, k, ghost) => {
      written = [];
      for (let i = 0; i < L; i++) {
        const one = wanted("distances") && near[i];
        tag(`line${i}`, one && `${one.mm.toFixed(0)} mm`, one && view.pixel(middle(...one.ends)), "distance");
      }
      data.marks.forEach((one, i) => tag(`mark${i}`, one.text, wanted("path") && Math.abs(one.time - time) > 0.2 && view.pixel(one.at), "mark"));
      things.forEach((one, i) => tag(`thing${i}`, one.name, one.label && view.pixel(one.label)));
      const rows = near.map((one) => [css(coloured(one.spare, GREEN)), `${one.pair}: ${one.mm.toFixed(0)} mm`]);
      part(".nearest")?.replaceChildren(...(rows.length ? rows : [["transparent", elsewhere() ? data.elsewhere : data.nothing]]).map(([colour, words]) => {
        const row = document.createElement("li"), mark = document.createElement("i");
        mark.style.background = colour;
        row.append(mark, words);
        return row;
      }));
      part(".time").textContent = elsewhere() ? "" : `${time.toFixed(2)} s`;
      part(".piece").textContent = live?.now || data.pieces.filter((one) => one.start <= time + 1e-9).at(-1).label;
      part("[name=time]").value = time;
      joints(k, ghost);
    };
    const cells = data.joints.map((one) => {
      const row = part(".joints tbody").insertRow(), name = row.insertCell();
      name.textContent = one.name;
      const [plan, real, bar] = [row.insertCell(), row.insertCell(), row.insertCell()];
      const meter = bar.appendChild(document.createElement("div")), place = meter.appendChild(document.createElement("i"));
      [plan.className, real.className, meter.className] = ["number", "number measured", "meter"];
      return { plan, real, place };
    });
    const shownValue = (value, unit) => unit === "rad" ? `${(value * 180 / Math.PI).toFixed(1)}°` : `${value.toFixed(3)} ${unit}`;
    const joints = (k, ghost) => data.joints.forEach((one, j) => {
      const value = live?.asked ? live.asked.q[j] : planned.q[k * J + j], share = (value - one.lower) / (one.upper - one.lower);
      cells[j].plan.textContent = shownValue(value, one.unit);
      cells[j].real.textContent = ghost ? shownValue(ghost.q[j], one.unit) : "";
      cells[j].place.style.cssText = Number.isFinite(share) ? `left:${(100 * share - 1.5).toFixed(1)}%;width:3%` : "display:none";
    });

    const strip = () => {  // below the slider: how narrow it is at each time
      const own = part("canvas.strip");
      if (!own) { return; }
      const context = own.getContext("2d");
      own.width = own.clientWidth;
      for (let x = 0; x < own.width; x++) {
        const [k, end] = [x, x + 1].map((p) => Math.floor(p * last / own.width));
        let least = Infinity;
        for (let i = k; i <= end; i++) { for (let b = 0; b < B; b++) { least = Math.min(least, left(i, b)); } }
        context.fillStyle = css(coloured(least, GREEN));
        context.fillRect(x, 0, 1, own.height);
      }
    };
    let pending = 0;
    const changed = () => { pending = pending || requestAnimationFrame(() => { pending = 0; paint(); }); };
    const eye = orbit(canvas, { azimuth: -1.05, elevation: 0.42, distance: 0.44 * data.size / Math.tan(FIELD / 2), target: data.middle }, changed);
    const step = (moment) => {
      if (!playing || !inSight) { tick = null; return; }
      slow = slow || (tick !== null && moment - tick > SLOW_MS);  // no graphics card: what is swept is shown when it stands
      if (tick !== null) { time = (time + Number(part("[name=speed]").value) * (moment - tick) / 1000) % (last * data.step); }
      tick = moment;
      paint();
      requestAnimationFrame(step);
    };
    const play = (on) => {
      playing = on;
      part(".play").textContent = on ? "Pause" : "Play";
      if (!on) { changed(); }
      if (on && tick === null) { requestAnimationFrame(step); }
    };
    const show = (own) => { play(false); time = Math.min(Math.max(own, 0), last * data.step); paint(); };
    const measure = (message) => {  // the real robot: its positions, and a frame of 12 numbers for each part, measured and asked
      const placed = (own) => own && { frame: new Float32Array(own.frames.flat()), points: own.points.flat(), q: own.q };
      live = { ...placed(message), asked: placed(message.asked), now: message.now, elsewhere: message.t === null };
      figure.classList.add("real");
      if (playing) { play(false); }
      if (Number.isFinite(message.t)) { show(message.t); } else { changed(); }
    };
    part(".play").addEventListener("click", () => play(!playing));
    part("[name=time]").addEventListener("input", (event) => show(Number(event.target.value)));
    for (const name of ["swept", "path", "distances"]) { part(`[name=${name}]`)?.addEventListener("change", changed); }
    figure.querySelectorAll("[data-time]").forEach((one) => one.addEventListener("click", () => show(Number(one.dataset.time))));
    new ResizeObserver(() => { strip(); changed(); }).observe(canvas);
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { kept = fixed(); changed(); });
    new IntersectionObserver(([entry]) => { inSight = entry.isIntersecting; if (inSight && playing && tick === null) { requestAnimationFrame(step); } }).observe(canvas);
    if (data.stream) { new EventSource(data.stream).addEventListener("message", (event) => measure(JSON.parse(event.data))); }
    figure.classList.toggle("real", Boolean(replay));
    figure.classList.add("drawn");
    part(".controls").hidden = false;
    strip();
    const wish = /^#t=([\d.]+)$/.exec(location.hash);  // view.html#t=12.5 stands there
    show(wish ? Number(wish[1]) : 0);
    play(!wish && !less.matches && !data.stream);
    figure.scene = { show, measure, camera: (change) => { Object.assign(eye.own, change); paint(); }, frames: () => [...now], real: () => { const own = real(); return own && { frame: [...own.frame], q: [...own.q] }; }, time: () => time };
  };
  document.querySelectorAll("figure.space").forEach(opened);
})();
