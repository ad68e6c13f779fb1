// Show points and cameras in 3-D, in the LiDAR frame. `data` holds the points, their colours by meaning, and one or more
// cameras; `choice` is the list of meanings. Elements of class cloud-label next to the canvas name the cameras.
function showCloud(canvas, data, choice) {
  // The drawing is kept, so that it can be printed.
  const gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) {
    canvas.replaceWith("This browser cannot show the points in 3-D: WebGL is not available.");
    choice.disabled = true;
    return;
  }
  canvas.addEventListener("webglcontextlost", () => canvas.replaceWith("The 3-D view was lost: reload the page."));
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const centimetres = new Int16Array(bytes(data.positions_cm).buffer);
  const positions = Float32Array.from(centimetres, (x) => x / 100);

  const compile = (type, source) => {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    return shader;
  };
  const program = gl.createProgram();
  gl.attachShader(program, compile(gl.VERTEX_SHADER, `
    attribute vec3 position;
    attribute vec3 color;
    uniform mat4 view;
    uniform float ratio;
    varying vec3 shade;
    void main() {
      gl_Position = view * vec4(position, 1.0);
      gl_PointSize = ratio * clamp(60.0 / gl_Position.w, 1.0, 4.0);
      shade = color;
    }`));
  gl.attachShader(program, compile(gl.FRAGMENT_SHADER, `
    precision mediump float;
    varying vec3 shade;
    void main() { gl_FragColor = vec4(shade, 1.0); }`));
  gl.linkProgram(program);
  gl.useProgram(program);

  const position = gl.getAttribLocation(program, "position");
  const color = gl.getAttribLocation(program, "color");
  const buffer = (array) => {
    const made = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, made);
    gl.bufferData(gl.ARRAY_BUFFER, array, gl.STATIC_DRAW);
    return made;
  };
  const cameras = data.cameras;
  const edges = [], edgeColors = [];
  const line = (from, to, color) => {
    edges.push(...from, ...to);
    edgeColors.push(...color, ...color);
  };
  const ahead = (camera, distance) => camera.camera_center.map((x, i) => x + distance * camera.optical_axis[i]);
  for (const camera of cameras) {
    const shade = camera.color;
    camera.corners.forEach((corner, i) => {
      line(camera.camera_center, corner, shade);
      line(corner, camera.corners[(i + 1) % camera.corners.length], shade);
    });
    line(camera.camera_center, ahead(camera, 2), shade);
  }
  // The LiDAR's axes: x red, y green, z blue.
  line([0, 0, 0], [1, 0, 0], [255, 70, 70]);
  line([0, 0, 0], [0, 1, 0], [70, 220, 70]);
  line([0, 0, 0], [0, 0, 1], [90, 140, 255]);
  const numEdges = edges.length / 3;

  const points = buffer(positions);
  const colors = Object.fromEntries(Object.entries(data.colors).map(([name, text]) => [name, buffer(bytes(text))]));
  const lines = buffer(new Float32Array(edges));
  const lineColors = buffer(new Uint8Array(edgeColors));

  // The view is from behind and above the camera, in its direction; with several cameras, from behind the LiDAR.
  const [first] = cameras, isOne = cameras.length === 1, axis = first.optical_axis;
  const start = isOne
    ? { yaw: Math.atan2(axis[1], axis[0]), pitch: 0.35, distance: 14 }
    : { yaw: 0.5, pitch: 0.6, distance: 6 };
  const eye = { ...start };
  const target = isOne ? first.camera_center.map((x, i) => x + 5 * axis[i] * (i === 2 ? 0.5 : 1)) : [0, 0, 0];

  function viewMatrix(aspect) {
    const { yaw, pitch, distance } = eye;
    const f = [Math.cos(yaw) * Math.cos(pitch), Math.sin(yaw) * Math.cos(pitch), -Math.sin(pitch)];
    const r = [Math.sin(yaw), -Math.cos(yaw), 0];
    const u = [r[1] * f[2] - r[2] * f[1], r[2] * f[0] - r[0] * f[2], r[0] * f[1] - r[1] * f[0]];
    const from = target.map((t, i) => t - distance * f[i]);
    const dot = (a) => a[0] * from[0] + a[1] * from[1] + a[2] * from[2];
    const near = 0.1, far = 600, s = 1.5;
    const a = (far + near) / (far - near), b = (2 * far * near) / (far - near);
    // Columns of projection times view: right, up, depth, distance ahead.
    const column = (i) => [s / aspect * r[i], s * u[i], a * f[i], f[i]];
    return new Float32Array([
      ...column(0), ...column(1), ...column(2),
      -s / aspect * dot(r), -s * dot(u), -a * dot(f) - b, -dot(f),
    ]);
  }

  function draw() {
    const ratio = devicePixelRatio || 1;
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0.063, 0.078, 0.094, 1);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const view = viewMatrix(canvas.width / canvas.height);
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "view"), false, view);
    gl.uniform1f(gl.getUniformLocation(program, "ratio"), ratio);
    const show = (mode, where, what, count) => {
      for (const [attribute, array, type, unit] of [[position, where, gl.FLOAT, false], [color, what, gl.UNSIGNED_BYTE, true]]) {
        gl.bindBuffer(gl.ARRAY_BUFFER, array);
        gl.enableVertexAttribArray(attribute);
        gl.vertexAttribPointer(attribute, 3, type, unit, 0, 0);
      }
      gl.drawArrays(mode, 0, count);
    };
    show(gl.POINTS, points, colors[choice.value], positions.length / 3);
    show(gl.LINES, lines, lineColors, numEdges);
    placeLabels(view);
  }

  const labels = canvas.parentElement.querySelectorAll(".cloud-label");
  function placeLabels(view) {
    labels.forEach((label, i) => {
      const at = [...ahead(cameras[i], 2.1), 1];
      const [x, y, , w] = [0, 1, 2, 3].map((row) => at.reduce((sum, value, column) => sum + view[4 * column + row] * value, 0));
      const left = (0.5 + 0.5 * x / w) * canvas.clientWidth - label.offsetWidth / 2;
      const top = (0.5 - 0.5 * y / w) * canvas.clientHeight - label.offsetHeight / 2;
      const isInside = w > 0 && left >= 0 && top >= 0
        && left + label.offsetWidth <= canvas.clientWidth && top + label.offsetHeight <= canvas.clientHeight;
      label.style.visibility = isInside ? "visible" : "hidden";
      label.style.transform = isInside ? `translate(${left}px, ${top}px)` : "";
    });
  }

  let pending = false;
  const redraw = () => {
    if (pending) return;
    pending = true;
    requestAnimationFrame(() => {
      pending = false;
      draw();
    });
  };
  const turn = (dx, dy) => {
    eye.yaw += dx;
    eye.pitch = Math.min(1.55, Math.max(-1.55, eye.pitch + dy));
    redraw();
  };
  const zoom = (factor) => {
    eye.distance = Math.min(200, Math.max(0.5, eye.distance * factor));
    redraw();
  };

  const fingers = new Map();
  const apart = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const last = fingers.get(event.pointerId);
    if (!last) return;
    const before = fingers.size === 2 ? apart() : 0;
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (fingers.size === 2) zoom(before / Math.max(1, apart()));
    else turn((last.x - event.clientX) * 0.006, (event.clientY - last.y) * 0.006);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    // The wheel alone scrolls the page.
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    zoom(Math.exp(event.deltaY * 0.002));
  }, { passive: false });
  canvas.addEventListener("dblclick", () => {
    Object.assign(eye, start);
    redraw();
  });
  canvas.addEventListener("keydown", (event) => {
    const moves = {
      ArrowLeft: () => turn(0.1, 0), ArrowRight: () => turn(-0.1, 0), ArrowUp: () => turn(0, 0.1),
      ArrowDown: () => turn(0, -0.1), "+": () => zoom(0.8), "-": () => zoom(1.25),
    };
    if (moves[event.key]) {
      event.preventDefault();
      moves[event.key]();
    }
  });
  const choose = () => {
    for (const legend of document.querySelectorAll("[data-choice]")) legend.hidden = legend.dataset.choice !== choice.value;
    redraw();
  };
  choice.addEventListener("change", choose);
  addEventListener("resize", redraw);
  choose();
  draw();
}

showCloud(
  document.getElementById("cloud-view"),
  JSON.parse(document.getElementById("cloud-data").textContent),
  document.getElementById("cloud-colors"),
);
