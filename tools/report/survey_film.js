// Draws any moment of a survey from the numbers beside it. Nothing is loaded, nothing plays unasked.
(() => {
  const figure = document.currentScript.closest("figure");
  const film = JSON.parse(figure.querySelector('script[type="application/json"]').textContent);
  const controls = figure.querySelector(".film");
  const [button, slider, speed, said] = ["button", "input", "select", "output"].map((tag) => controls.querySelector(tag));
  const svg = figure.querySelector("svg.chart");
  const cells = [...svg.querySelectorAll(".cells rect")];
  const dots = ["ondark", "onbright"].map((style) => svg.querySelector(`.dots.${style}`));
  const trails = [...svg.querySelectorAll(".trail")];
  const fish = [...svg.querySelectorAll(".fish")];
  const base = svg.querySelector(".base");
  const TRAIL = 300;
  const summed = (row) => { let sum = 0; return row.map((step) => (sum += step)); };
  const ways = film.robots.map((robot) => robot.p.map(summed));
  // How many of an ascending row are not after t.
  const upto = (row, t) => {
    let low = 0, high = row.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (row[middle] <= t) low = middle + 1; else high = middle;
    }
    return low;
  };
  const sampleTimes = film.samples.map((sample) => sample[0]);
  const knownTimes = film.known.map((state) => state[0]);
  const during = (spans, t) => spans.some(([start, end]) => start <= t && t <= end);
  let shown = "";
  const paintCells = (t) => {
    const count = upto(sampleTimes, t), state = upto(knownTimes, t);
    if (shown === `${count} ${state}`) return;
    shown = `${count} ${state}`;
    const letters = state ? film.known[state - 1][2] : "";
    const levels = cells.map((_, n) => (letters && letters[n] !== "-" ? parseInt(letters[n], 36) : -1));
    const sampled = new Map();
    for (const [, cell, level] of film.samples.slice(0, count)) sampled.set(cell, level);
    for (const [cell, level] of sampled) if (levels[cell] < 0) levels[cell] = level;
    cells.forEach((rect, n) => rect.setAttribute("fill", levels[n] < 0 ? "none" : `#${film.palette[levels[n]]}`));
    const d = ["", ""];
    for (const cell of sampled.keys()) {
      const x = film.origin[0] + (cell % film.columns + .5) * film.side;
      const y = film.origin[1] - (Math.floor(cell / film.columns) + .5) * film.side;
      d[levels[cell] >= film.bright ? 1 : 0] += `M${x.toFixed(1)},${y.toFixed(1)}h0`;
    }
    dots.forEach((path, n) => path.setAttribute("d", d[n]));
  };
  const at = (way, t) => {
    const [time, x, y] = way, n = upto(time, t);
    if (n === 0) return [x[0], y[0]];
    if (n === time.length) return [x[n - 1], y[n - 1]];
    const part = (t - time[n - 1]) / (time[n] - time[n - 1]);
    return [x[n - 1] + part * (x[n] - x[n - 1]), y[n - 1] + part * (y[n] - y[n - 1])];
  };
  const heading = ([time, x, y], t) => {
    for (let n = Math.min(Math.max(upto(time, t), 1), time.length - 1); n > 0; n--) {
      const dx = x[n] - x[n - 1], dy = y[n] - y[n - 1];
      if (Math.hypot(dx, dy) > 0) return Math.atan2(dy, dx) * 180 / Math.PI;
    }
    return 0;
  };
  const draw = (t) => {
    paintCells(t);
    const dead = [];
    film.robots.forEach((robot, n) => {
      const way = ways[n];
      if (!way[0].length) return;
      const [x, y] = at(way, t).map((value) => value / 10), gone = during(robot.dead, t);
      if (gone) dead.push(robot.n);
      fish[n].setAttribute("transform", `translate(${x.toFixed(1)},${y.toFixed(1)}) rotate(${heading(way, t).toFixed(0)})`);
      fish[n].setAttribute("class", `fish ${gone ? "dead" : robot.c}`);
      fish[n].nextElementSibling.setAttribute("transform", `translate(${x.toFixed(1)},${y.toFixed(1)})`);
      const first = upto(way[0], t - TRAIL), last = upto(way[0], t);
      const points = [at(way, t - TRAIL)];
      for (let k = first; k < last; k++) points.push([way[1][k], way[2][k]]);
      points.push(at(way, t));
      const d = gone ? "" : `M${points.map(([a, b]) => `${(a / 10).toFixed(1)},${(b / 10).toFixed(1)}`).join("L")}`;
      for (const path of trails[n].children) path.setAttribute("d", d);
    });
    const out = during(film.base, t);
    if (base) base.classList.toggle("lost", out);
    const state = upto(knownTimes, t), wanted = state ? film.known[state - 1][1] : 0;
    const cellsKnown = new Set(film.samples.slice(0, upto(sampleTimes, t)).map((sample) => sample[1])).size;
    const words = [`${(t / 10).toFixed(0)} s`, `${cellsKnown} cells sampled` + (wanted ? ` of ${wanted} wanted so far` : "")];
    if (dead.length) words.push(`dead: ${dead.join(", ")}`);
    if (out) words.push("base station out of reach");
    if (film.complete !== null && t >= film.complete) words.push("the field is known");
    said.textContent = words.join(" · ");
  };
  let t = film.end, last = null, playing = false, frame = 0;
  const show = () => { slider.value = t / 10; draw(t); };
  const play = (on) => {
    playing = on;
    last = null;
    button.textContent = on ? "pause" : "play";
    cancelAnimationFrame(frame);
    if (on) frame = requestAnimationFrame(step);
  };
  const step = (now) => {
    if (!playing) return;
    if (last !== null) t = Math.min(t + (now - last) / 100 * Number(speed.value), film.end);
    last = now;
    show();
    if (t >= film.end) play(false); else frame = requestAnimationFrame(step);
  };
  button.addEventListener("click", () => { if (!playing && t >= film.end) t = 0; play(!playing); });
  slider.addEventListener("input", () => { t = 10 * Number(slider.value); draw(t); });
  controls.hidden = false;
  show();
})();
