// Points on images: the points of each frame are unpacked once, and coloured by class or edge, depth or agreement.
const Points = (() => {
  const NOT_SEEN = 255, NO_PAIR = 3, HIDDEN = 2, DISAGREES = 1;
  const COLUMNS_PER_RADIUS = 640;
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

  const unpack = (packed) => ({
    scale: packed.scale,
    classes: bytes(packed.classes),
    intensities: packed.intensities ? bytes(packed.intensities) : null,
    poses: packed.poses.map((pose) => ({
      positions: new Uint16Array(bytes(pose.positions).buffer),
      kinds: bytes(pose.kinds),
      levels: bytes(pose.levels),
    })),
  });

  const packedColors = (table) => Uint32Array.from(table, (color) => {
    if (!color) return 0;
    const [r, g, b] = color;
    return (255 << 24 | b << 16 | g << 8 | r) >>> 0;
  });
  const tables = (palette) => Object.fromEntries(Object.entries(palette).map(([name, table]) => [name, packedColors(table)]));

  // Colour of a point, or 0 if the choice does not show it.
  const color = (points, pose, i, choice, colors) => {
    const kind = pose.kinds[i];
    if (choice === "agreement") return kind < NO_PAIR ? colors.agreement[kind] : 0;
    if (kind === HIDDEN) return 0;
    if (choice === "depth") return colors.depth[pose.levels[i]];
    if (choice === "intensity") return colors.depth[points.intensities[i]];
    return colors[choice][points.classes[i]] || 0;  // by class or edge
  };

  // Draw the points in a window of the image: left, top, width and height in pixels.
  function draw(canvas, points, number, choice, colors, window) {
    const ratio = Math.min(devicePixelRatio || 1, 2);
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    const { width, height } = canvas;
    const [left, top, wide] = window, scale = width / wide;
    const context = canvas.getContext("2d"), image = context.createImageData(width, height);
    const out = new Uint32Array(image.data.buffer);
    const radius = Math.max(1, Math.round(Math.max(width / COLUMNS_PER_RADIUS, Math.min(scale / 2, 5))));
    const spots = [];
    for (let dy = -radius; dy <= radius; dy++) {
      for (let dx = -radius; dx <= radius; dx++) if (dx * dx + dy * dy <= (radius + 0.5) ** 2) spots.push([dx, dy]);
    }
    const pose = points.poses[number];
    let drawn = 0;
    // What disagrees is drawn last, on top.
    for (const isLast of choice === "agreement" ? [false, true] : [null]) {
      for (let i = 0; i < pose.kinds.length; i++) {
        const kind = pose.kinds[i];
        if (kind === NOT_SEEN || (isLast !== null && isLast !== (kind === DISAGREES))) continue;
        const paint = color(points, pose, i, choice, colors);
        if (!paint) continue;
        const x = Math.floor((pose.positions[2 * i] / points.scale - left) * scale);
        const y = Math.floor((pose.positions[2 * i + 1] / points.scale - top) * scale);
        if (x < -radius || y < -radius || x >= width + radius || y >= height + radius) continue;
        drawn++;
        for (const [dx, dy] of spots) {
          const u = x + dx, v = y + dy;
          if (u >= 0 && v >= 0 && u < width && v < height) out[v * width + u] = paint;
        }
      }
    }
    context.putImageData(image, 0, 0);
    canvas.dataset.drawn = drawn;
  }

  return { unpack, tables, draw };
})();
