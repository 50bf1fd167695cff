// What is written over the scene that the page draws: names of bodies, the axes, the scale.
(function () {
  const SIZE = 12, INKS = { true: ["#e2e8f0", "rgba(15,20,28,.8)"], false: ["#1e2632", "rgba(255,255,255,.85)"] };
  const AXES = [["x", "#ff6b6b", [1, 0, 0]], ["y", "#59c36a", [0, 1, 0]], ["z", "#5aa9f7", [0, 0, 1]]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  // The largest of 1, 2, 5 × 10ⁿ that is no longer than a length
  function round(length) {
    const ten = 10 ** Math.floor(Math.log10(length));
    return [5, 2, 1].find((step) => step * ten <= length * (1 + 1e-9)) * ten;
  }

  // Pixels of the page of a place, null behind the camera
  function spot(place, flat, width, height) {
    const clip = [0, 1, 3].map((row) => flat[row] * place[0] + flat[4 + row] * place[1]
                                        + flat[8 + row] * place[2] + flat[12 + row]);
    return clip[2] > 0 ? [(clip[0] / clip[2] + 1) * width / 2, (1 - clip[1] / clip[2]) * height / 2]
                       : null;
  }

  // Move a label upward until it covers no other
  function free(box, taken) {
    for (let n = 0; n <= taken.length; n++) {
      const hit = taken.find((t) => t.x < box.x + box.w && box.x < t.x + t.w
                                    && t.y < box.y + box.h && box.y < t.y + t.h);
      if (!hit) break;
      box = { ...box, y: hit.y - box.h - 2 };
    }
    return box;
  }

  function names(pen, scene, view, width, height) {
    const { names, low, high, count } = scene.parts.bodies, taken = [];
    const [ink, panel] = INKS[scene.parts.style.dark];
    for (let i = 0; i < names.length; i++) {
      if (!scene.alphas[i] || !count[i]) continue;
      const seen = [];
      for (let k = 0; k < 8; k++) {
        const corner = [0, 1, 2].map((axis) => ((k >> axis) & 1 ? high : low)[i][axis]);
        const at = spot(corner, view.flat, width, height);
        if (at) seen.push(at);
      }
      if (!seen.length) continue;
      const xs = seen.map((p) => p[0]), top = Math.min(...seen.map((p) => p[1]));
      const w = pen.measureText(names[i]).width + 8, h = 1.45 * SIZE;
      const left = Math.min(...xs), right = Math.max(...xs);
      if (right < 0 || left > width || top > height) continue;
      const x = Math.min(Math.max((left + right) / 2 - w / 2, 0), width - w);
      const box = free({ x, y: top - 1.5 * SIZE, w, h }, taken);
      if (box.x < 0 || box.y < 0 || box.y > height - SIZE) continue;
      taken.push(box);
      pen.fillStyle = panel;
      pen.fillRect(box.x, box.y, w, h);
      pen.fillStyle = ink;
      pen.fillText(names[i], box.x + 4, box.y + h / 2);
    }
    return taken.length;
  }

  function axes(pen, view, x, y) {
    const arms = AXES.map(([name, color, axis]) => ({ name, color, dx: dot(view.right, axis),
      dy: -dot(view.up, axis), depth: dot(view.forward, axis) }));
    arms.sort((a, b) => b.depth - a.depth);  // what points away is drawn first
    for (const { name, color, dx, dy } of arms) {
      pen.strokeStyle = pen.fillStyle = color;
      pen.beginPath(); pen.moveTo(x, y); pen.lineTo(x + 22 * dx, y + 22 * dy); pen.stroke();
      if (Math.hypot(dx, dy) > 0.2) pen.fillText(name, x + 30 * dx - 3, y + 30 * dy);
    }
  }

  // A length in the plane through the focal point; only an orthographic picture has one scale
  function scale(pen, scene, x, y, height) {
    const { style } = scene.parts, perPixel = scene.camera.height / height;
    const length = round(110 * perPixel), wide = length / perPixel;
    pen.strokeStyle = pen.fillStyle = INKS[style.dark][0];
    pen.beginPath();
    pen.moveTo(x - wide, y - 4); pen.lineTo(x - wide, y); pen.lineTo(x, y); pen.lineTo(x, y - 4);
    pen.stroke();
    const text = `${Number(length.toPrecision(1))} ${style.unit}`;
    pen.fillText(text, x - (wide + pen.measureText(text).width) / 2, y - 10);
    return text;
  }

  // Writes over a picture that was just painted; returns what it wrote, for those who test it
  function letter(canvas, scene, view) {
    const ratio = scene.ratio || 1, pen = canvas.getContext("2d");
    if (canvas.width !== scene.canvas.width || canvas.height !== scene.canvas.height) {
      canvas.width = scene.canvas.width; canvas.height = scene.canvas.height;
    }
    const width = canvas.width / ratio, height = canvas.height / ratio;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = `${SIZE}px sans-serif`;
    pen.textBaseline = "middle";
    pen.lineWidth = 1.5;
    const written = scene.parts.style.names ? names(pen, scene, view, width, height) : 0;
    axes(pen, view, width - 42, height - 44);
    const text = scene.camera.parallel ? scale(pen, scene, width - 90, height - 22, height) : "";
    return { names: written, scale: text };
  }

  window.RaymapLettering = { letter };
})();
