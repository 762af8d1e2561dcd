// Plays laminae in a canvas. The JSON of a figure has:
//   names, colours, thickness [mm]   of each lamina, from bottom to top
//   x [mm]                           of each node
//   time [s]                         of each frame; period [s] of the excitation, or null
//   y                                positions of the middle lines in units of `unit` [mm]: base64 of int16,
//                                    (frame, lamina, node)
//   lit                              0 apart, 1 hit since the frame before, 2 resting: base64 of uint8,
//                                    (frame, interface, node)
//   factor                           of deflections and gaps in y
//   held                             whether both ends are held
//   stops                            x, side (1 above, -1 below), y and lit at each frame of stops and inner supports
"use strict";
for (const figure of document.querySelectorAll("figure.film")) {
  const film = JSON.parse(figure.querySelector("script").textContent);
  const canvas = figure.querySelector("canvas");
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const view = new DataView(bytes(film.y).buffer);
  const y = Float32Array.from({ length: view.byteLength / 2 }, (_, k) => film.unit * view.getInt16(2 * k, true));
  const lit = bytes(film.lit);
  const [nLaminae, nNodes, nFrames] = [film.names.length, film.x.length, film.time.length];
  const length = film.x[nNodes - 1] - film.x[0];
  const [HIT, RESTING] = [1, 2];
  const STRIP = 84;
  let position = 0, shown = 0, before = 0, isPlaying = false, isTrue = false, last = null;
  const at = (frame, lamina, node) => y[(frame * nLaminae + lamina) * nNodes + node];

  let low = Infinity, high = -Infinity;
  for (let k = 0; k < y.length; k++) {
    const half = film.thickness[Math.floor(k / nNodes) % nLaminae] / 2;
    low = Math.min(low, y[k] - half);
    high = Math.max(high, y[k] + half);
  }
  for (const stop of film.stops) for (const v of stop.y) [low, high] = [Math.min(low, v), Math.max(high, v)];

  function make(tag, properties, parent) {
    const element = Object.assign(document.createElement(tag), properties);
    parent.append(element);
    return element;
  }
  const tools = document.createElement("div");
  tools.className = "tools";
  canvas.after(tools);
  const play = make("button", { type: "button" }, tools);
  const scrub = make("input", { type: "range", min: 0, max: nFrames - 1, step: 1, value: 0 }, tools);
  scrub.setAttribute("aria-label", "frame");
  const clock = make("output", {}, tools);
  const speed = make("select", { title: "speed" }, tools);
  speed.setAttribute("aria-label", "speed");
  const rates = [1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01];
  for (const rate of rates) {
    make("option", { value: rate, textContent: rate === 1 ? "real time" : `1/${Math.round(1 / rate)} of real time` }, speed);
  }
  const wanted = film.period === null ? 1 : film.period / 2.5; // a period in some 2.5 s
  speed.value = rates.reduce((a, b) => (Math.abs(Math.log(b / wanted)) < Math.abs(Math.log(a / wanted)) ? b : a));
  const scaling = make("button", { type: "button" }, tools);

  function layout() {
    const width = figure.clientWidth, height = Math.round(Math.min(380, Math.max(230, 0.42 * width)));
    const ratio = window.devicePixelRatio || 1;
    canvas.style.height = `${height + STRIP}px`;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round((height + STRIP) * ratio);
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    const [left, right, top, bottom] = [58, 22, 24, 34];
    const scaleX = (width - left - right) / length;
    const stretched = (height - top - bottom) / (high - low);
    const scaleY = isTrue ? Math.min(scaleX, stretched) : stretched;
    const middle = top + (height - top - bottom) / 2;
    return {
      pen, width, height, left, right, stretch: scaleY / scaleX,
      px: (x) => left + (x - film.x[0]) * scaleX,
      py: (v) => middle - (v - (low + high) / 2) * scaleY,
    };
  }

  function colour(name) {
    return getComputedStyle(figure).getPropertyValue(name).trim();
  }

  function steps(from, to, count) {
    const raw = (to - from) / count, power = 10 ** Math.floor(Math.log10(raw));
    const step = power * [1, 2, 5, 10].find((m) => m * power >= raw);
    const ticks = [];
    for (let v = Math.ceil(from / step) * step; v <= to + 1e-9 * step; v += step) ticks.push(Math.round(v / step) * step);
    return ticks;
  }

  function axes({ pen, px, py, width, height, left, right, stretch }) {
    pen.fillStyle = colour("--soft");
    pen.strokeStyle = colour("--line");
    pen.lineWidth = 1;
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "center";
    for (const x of steps(film.x[0], film.x[nNodes - 1], Math.max(3, width / 120))) {
      pen.fillText(String(+x.toPrecision(6)), px(x), height - 18);
    }
    pen.textAlign = "right";
    for (const v of steps(low, high, isTrue && stretch < 1.01 ? 2 : 5)) {
      pen.beginPath();
      pen.moveTo(left, py(v));
      pen.lineTo(width - right, py(v));
      pen.stroke();
      if (film.factor === 1) pen.fillText(String(+v.toPrecision(6)), left - 16, py(v) + 4);
    }
    pen.fillText("x [mm]", width - right, height - 4);
    pen.textAlign = "left";
    const how = Math.abs(stretch - 1) < 0.01 ? "true to scale" : `lateral × ${stretch.toPrecision(2)}`;
    const larger = film.factor === 1 ? "" : `, deflections and gaps × ${film.factor}`;
    pen.fillText(film.factor === 1 ? `y [mm], ${how}` : how + larger, 4, 14);
  }

  function clamps({ pen, px, py, width, right }, middle) {
    pen.fillStyle = colour("--soft");
    film.held.forEach((isHeld, end) => {
      if (!isHeld) return;
      const node = end ? nNodes - 1 : 0;
      const top = py(middle(nLaminae - 1, node) + film.thickness[nLaminae - 1] / 2) - 8;
      const bottom = py(middle(0, node) - film.thickness[0] / 2) + 8;
      pen.fillRect(end ? width - right : px(film.x[0]) - 9, top, 9, bottom - top);
    });
  }

  function contacts({ pen, px, py }, middle, first) {
    const nInterfaces = nLaminae - 1;
    for (let j = 0; j < nInterfaces; j++) {
      for (let n = 0; n < nNodes; n++) {
        let state = 0;
        for (let k = first; k <= shown; k++) {
          const own = lit[(k * nInterfaces + j) * nNodes + n];
          if (own === HIT || (own === RESTING && k === shown)) state = state === HIT ? HIT : own;
        }
        if (!state) continue;
        const face = (middle(j, n) + film.thickness[j] / 2 + middle(j + 1, n) - film.thickness[j + 1] / 2) / 2;
        pen.beginPath();
        pen.fillStyle = state === HIT ? "#F0A000" : colour("--text");
        if (state === HIT) pen.arc(px(film.x[n]), py(face), 6, 0, 2 * Math.PI);
        else pen.rect(px(film.x[n]) - 3, py(face) - 3, 6, 6);
        pen.fill();
      }
    }
  }

  function stops({ pen, px, py }) {
    for (const stop of film.stops) {
      const [x, y] = [px(stop.x), py(stop.y[shown])];
      const state = Math.max(...stop.lit.slice(before < shown && shown - before < 6 ? before + 1 : shown, shown + 1));
      pen.fillStyle = state === HIT ? "#F0A000" : colour(state === RESTING ? "--text" : "--soft");
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x - 7, y - 12 * stop.side);
      pen.lineTo(x + 7, y - 12 * stop.side);
      pen.fill();
    }
  }

  function strip({ pen, width, height, left, right }) {
    const top = height + 8, bottom = height + STRIP - 8, n = nNodes - 1;
    let [least, most] = [Infinity, -Infinity];
    for (let k = 0; k < nFrames; k++) for (let i = 0; i < nLaminae; i++) {
      least = Math.min(least, at(k, i, n));
      most = Math.max(most, at(k, i, n));
    }
    const sx = (k) => left + (width - left - right) * (k / Math.max(1, nFrames - 1));
    const sy = (v) => bottom - ((v - least) / (most - least || 1)) * (bottom - top);
    pen.lineWidth = 1;
    for (let i = 0; i < nLaminae; i++) {
      pen.strokeStyle = film.colours[i];
      pen.beginPath();
      for (let k = 0; k < nFrames; k++) pen.lineTo(sx(k), sy(at(k, i, n)));
      pen.stroke();
    }
    pen.strokeStyle = colour("--text");
    pen.beginPath();
    pen.moveTo(sx(position), top - 4);
    pen.lineTo(sx(position), bottom + 4);
    pen.stroke();
    pen.fillStyle = colour("--soft");
    pen.textAlign = "left";
    pen.fillText("ends", 4, (top + bottom) / 2);
  }

  function draw() {
    const place = layout(), { pen, px, py } = place;
    shown = Math.min(nFrames - 1, Math.floor(position + 1e-6));
    const next = Math.min(nFrames - 1, shown + 1), part = position - shown;
    const middle = (i, n) => (1 - part) * at(shown, i, n) + part * at(next, i, n);
    axes(place);
    clamps(place, middle);
    for (let i = 0; i < nLaminae; i++) {
      const half = film.thickness[i] / 2;
      pen.beginPath();
      for (let n = 0; n < film.ends[i]; n++) pen.lineTo(px(film.x[n]), py(middle(i, n) + half));
      for (let n = film.ends[i] - 1; n >= 0; n--) pen.lineTo(px(film.x[n]), py(middle(i, n) - half));
      pen.closePath();
      pen.fillStyle = pen.strokeStyle = film.colours[i];
      pen.lineWidth = 1;
      pen.fill();
      pen.stroke();
    }
    contacts(place, middle, before < shown && shown - before < 6 ? before + 1 : shown);
    stops(place);
    pen.font = "12px system-ui, sans-serif";
    let right = place.width - 8;
    pen.textAlign = "right";
    for (let i = 0; i < nLaminae; i++) {
      pen.fillStyle = film.colours[i];
      pen.fillText(film.names[i], right, 14);
      right -= pen.measureText(film.names[i]).width + 14;
    }
    strip(place);
    before = shown;
    const t = film.time[shown];
    clock.textContent = `t = ${t.toFixed(3)} s` + (film.period === null ? "" : ` = ${(t / film.period).toFixed(2)} T`);
    scrub.value = shown;
    figure.dataset.frame = shown;
  }

  function tick(now) {
    if (!isPlaying) return;
    if (last !== null && nFrames > 1) {
      const spacing = (film.time[nFrames - 1] - film.time[0]) / (nFrames - 1);
      position += (Math.min(0.1, (now - last) / 1000) * Number(speed.value)) / spacing;
      if (position > nFrames - 1) position = before = 0;
    }
    last = now;
    draw();
    requestAnimationFrame(tick);
  }

  function go(playing) {
    isPlaying = playing;
    last = null;
    play.textContent = playing ? "❚❚ pause" : "▶ play";
    if (playing) requestAnimationFrame(tick);
  }

  function jump(frame) {
    go(false);
    position = Math.max(0, Math.min(nFrames - 1, frame));
    before = Math.floor(position);
    draw();
  }

  function rescale() {
    scaling.textContent = isTrue ? "stretch" : "true to scale";
    draw();
  }

  play.addEventListener("click", () => go(!isPlaying));
  scrub.addEventListener("input", () => jump(Number(scrub.value)));
  scaling.addEventListener("click", () => {
    isTrue = !isTrue;
    rescale();
  });
  canvas.addEventListener("pointerdown", (event) => {
    const frame = canvas.getBoundingClientRect();
    if (event.clientY - frame.top < frame.height - STRIP) return;
    jump(Math.round(((event.clientX - frame.left - 58) / (frame.width - 80)) * (nFrames - 1)));
  });
  new ResizeObserver(draw).observe(figure);
  for (const query of ["(prefers-color-scheme: dark)", "print"]) {
    window.matchMedia(query).addEventListener("change", draw);
  }
  rescale();
  go(!window.matchMedia("(prefers-reduced-motion: reduce)").matches);
}
