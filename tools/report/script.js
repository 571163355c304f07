// Values under the pointer: each chart carries its scales, each line its label. Nothing is loaded.
(() => {
  const tip = document.createElement("div");
  tip.className = "tip";
  document.body.append(tip);
  const cache = new WeakMap();
  const points = (path) => {
    if (!cache.has(path)) {
      cache.set(path, path.getAttribute("d").slice(1).split("L").map((p) => p.split(",").map(Number)));
    }
    return cache.get(path);
  };
  const nearest = (list, x) => {
    let low = 0, high = list.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (list[middle][0] < x) low = middle; else high = middle;
    }
    return x - list[low][0] < list[high][0] - x ? list[low] : list[high];
  };
  const text = (value) => Number(value.toPrecision(4)).toString().replace("-", "−");
  for (const svg of document.querySelectorAll("svg.chart")) {
    const lines = [...svg.querySelectorAll("path[data-label]")];
    if (!lines.length) continue;
    const [x0, x1, a, b] = svg.dataset.x.split(" ").map(Number);
    const [y0, y1, c, d] = svg.dataset.y.split(" ").map(Number);
    const cursor = document.createElementNS("http://www.w3.org/2000/svg", "line");
    cursor.setAttribute("class", "cursor");
    cursor.setAttribute("y1", d);
    cursor.setAttribute("y2", c);
    svg.append(cursor);
    const hide = () => { tip.style.opacity = 0; cursor.style.opacity = 0; };
    svg.addEventListener("pointerleave", hide);
    svg.addEventListener("pointermove", (event) => {
      const x = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse()).x;
      if (x < a || x > b) return hide();
      cursor.setAttribute("x1", x);
      cursor.setAttribute("x2", x);
      cursor.style.opacity = 1;
      const rows = [`${text(x0 + (x - a) / (b - a) * (x1 - x0))} s`];
      for (const line of lines) {
        const list = points(line);
        if (x < list[0][0] - 2 || x > list[list.length - 1][0] + 2) continue;
        const y = nearest(list, x)[1];
        rows.push(`${line.dataset.label}  ${text(y0 + (y - c) / (d - c) * (y1 - y0))} ${svg.dataset.unit}`);
      }
      tip.textContent = rows.join("\n");
      tip.style.opacity = .95;
      const left = Math.min(event.clientX + 14, innerWidth - tip.offsetWidth - 8);
      tip.style.left = `${left}px`;
      tip.style.top = `${event.clientY + 16}px`;
    });
  }
})();
