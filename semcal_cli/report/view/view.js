(() => {
  const data = JSON.parse(document.getElementById("view-data").textContent);
  const colors = Points.tables(data.palette);
  const byId = (id) => document.getElementById(id);
  const image = byId("image"), canvas = byId("points"), background = byId("background");
  const sliders = [...document.querySelectorAll(".motion input[type=range]")];
  const numbers = [...document.querySelectorAll(".motion input[type=number]")];
  // Largest motion of the sliders, in centimetres and degrees.
  const REACHES = { fine: [5, 0.5], medium: [50, 10], whole: [500, 180] };
  const FARTHEST = 10000, KEY_STEP_PX = 4;
  const chosen = (name) => document.querySelector(`input[name=${name}]:checked`).value;

  const offsets = [0, 0, 0, 0, 0, 0];  // centimetres and degrees
  const poses = [];  // poses before refining, resetting or choosing a mounting
  let base = data.start || data.mountings[byId("mounting").value];
  let frame = 0, points = null;
  const course = [];
  let lastPose = "", best = 1e-12;

  const asked = () => ({ base, offsets: offsets.map((x, i) => (i < 3 ? x / 100 : x)), frame });

  async function ask(name, body) {
    const response = await fetch(name, { method: "POST", body: JSON.stringify(body) });
    const found = await response.json();
    if (found.error) throw new Error(found.error);
    return found;
  }

  function tell(text, status) {
    byId("message").className = status || "";
    byId("message").textContent = text;
  }

  function draw() {
    if (points) Points.draw(canvas, points, 0, chosen("colors"), colors, [0, 0, data.width, data.height]);
  }

  function drawCourse() {
    const view = byId("course");
    if (!view || course.length < 2) return;
    const ratio = devicePixelRatio || 1;
    view.width = Math.round(view.clientWidth * ratio);
    view.height = Math.round(view.clientHeight * ratio);
    const context = view.getContext("2d"), least = Math.min(...course), most = Math.max(...course);
    const style = getComputedStyle(document.documentElement);
    const y = (value) => view.height * (0.92 - 0.84 * (value - least) / Math.max(most - least, 1e-9));
    context.strokeStyle = style.getPropertyValue("--line");
    context.beginPath();
    context.moveTo(0, y(most));
    context.lineTo(view.width, y(most));
    context.stroke();
    context.strokeStyle = style.getPropertyValue("--accent");
    context.lineWidth = 1.5 * ratio;
    context.beginPath();
    course.forEach((value, i) => context.lineTo(view.width * i / (course.length - 1), y(value)));
    context.stroke();
  }

  function show(found) {
    points = Points.unpack(found.points);
    draw();
    byId("transform").textContent = found.text;
    byId("frame-name").textContent = `${data.frames[frame]} (${frame + 1} of ${data.frames.length})`;
    const share = found.agreement_of_frame;
    byId("frame-agreement").textContent = share === null ? `${found.num_visible} points` : `${(100 * share).toFixed(1)} % agree`;
    if (found.information !== null) {
      best = Math.max(best, found.information);
      byId("share").textContent = `${(100 * Math.max(found.information, 0) / best).toFixed(0)} %`;
      byId("information").textContent = found.information.toFixed(4);
      if (found.text !== lastPose) course.push(found.information);
      lastPose = found.text;
      if (course.length > 300) course.shift();
      byId("course-figure").hidden = course.length < 2;
      drawCourse();
    }
    image.dataset.shown = Number(image.dataset.shown || 0) + 1;
  }

  // One request at a time; changes in the meantime are sent together afterwards.
  let isAsking = false, isStale = false;
  async function update() {
    isStale = true;
    if (isAsking) return;
    isAsking = true;
    try {
      while (isStale) {
        isStale = false;
        show(await ask("points", asked()));
        if (byId("message").className === "error") tell("");
      }
    } catch (error) {
      tell(error.message, "error");
    } finally {
      isAsking = false;
    }
  }

  const reachOf = (i) => REACHES[chosen("reach")][i < 3 ? 0 : 1];
  // A slider is centred on its last value, so that nothing is lost when the range changes.
  function center(i) {
    sliders[i].min = offsets[i] - reachOf(i);
    sliders[i].max = offsets[i] + reachOf(i);
    sliders[i].value = offsets[i];
  }
  function place(i, value) {
    offsets[i] = Math.min(FARTHEST, Math.max(-FARTHEST, value));
    if (offsets[i] < sliders[i].min || offsets[i] > sliders[i].max) center(i);
    sliders[i].value = offsets[i];
    numbers[i].value = Number(offsets[i].toFixed(i < 3 ? 2 : 4));
    update();
  }
  const reach = () => sliders.forEach((_, i) => center(i));
  function begin(T) {
    base = T;
    offsets.fill(0);
    reach();
    numbers.forEach((number) => { number.value = 0; });
    byId("back").disabled = poses.length === 0;
    update();
  }
  const leave = () => poses.push({ base, offsets: [...offsets] });

  sliders.forEach((slider, i) => slider.addEventListener("input", () => place(i, Number(slider.value))));
  numbers.forEach((number, i) => number.addEventListener("change", () => {
    if (Number.isFinite(number.valueAsNumber)) place(i, number.valueAsNumber);
    else number.value = offsets[i];
  }));
  for (const input of document.querySelectorAll("input[name=reach]")) input.addEventListener("change", reach);

  // Pairs of a point, clicked on in the sweep, and a pixel, clicked on in the image.
  const sweep = byId("sweep"), panorama = byId("panorama");
  let picked = null;  // point without its pixel
  let pairs = [];
  function pin(container, x, y) {
    const mark = document.createElement("b");
    mark.className = "pin";
    mark.dataset.frame = frame;
    mark.textContent = pairs.length + 1;
    mark.style.left = `${100 * x}%`;
    mark.style.top = `${100 * y}%`;
    container.append(mark);
    return mark;
  }
  function showPairs() {
    for (const mark of document.querySelectorAll(".pin")) mark.hidden = Number(mark.dataset.frame) !== frame;
    document.body.classList.toggle("picking", picked !== null);
    byId("num-pairs").textContent = picked ? "now click the same place in the image" : `${pairs.length || "no"} pair${pairs.length === 1 ? "" : "s"}${pairs.length ? "" : " yet"}`;
    byId("use-pairs").disabled = pairs.length < 2;
    byId("clear-pairs").disabled = pairs.length === 0 && picked === null;
  }
  sweep.addEventListener("click", async (event) => {
    const box = panorama.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width, y = (event.clientY - box.top) / box.height;
    try {
      const found = await ask("pick", { frame, at: [x * panorama.naturalWidth, y * panorama.naturalHeight] });
      if (picked) picked.mark.remove();
      const mark = pin(sweep, found.at[0] / panorama.naturalWidth, found.at[1] / panorama.naturalHeight);
      picked = { point: found.point, mark };
    } catch (error) {
      tell(error.message, "error");
    }
    showPairs();
  });
  image.addEventListener("click", (event) => {
    if (!picked) return;
    const box = image.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width, y = (event.clientY - box.top) / box.height;
    pin(image, x, y);
    pairs.push({ point: picked.point, pixel: [x * data.width - 0.5, y * data.height - 0.5] });
    picked = null;
    showPairs();
  });
  function clearPairs() {
    for (const mark of document.querySelectorAll(".pin")) mark.remove();
    picked = null;
    pairs = [];
    showPairs();
  }
  byId("clear-pairs").addEventListener("click", clearPairs);
  byId("picking").addEventListener("toggle", () => showSweep());
  function showSweep() {
    const source = `sweep/${frame}`;
    if (byId("picking").open && panorama.getAttribute("src") !== source) panorama.src = source;
    showPairs();
  }

  // The mouse drags what is under it.
  let last = null;
  image.addEventListener("pointerdown", (event) => {
    if (picked) return;
    image.setPointerCapture(event.pointerId);
    last = [event.clientX, event.clientY];
  });
  image.addEventListener("pointermove", (event) => {
    if (!last) return;
    const scale = data.width / image.clientWidth;
    const dx = (event.clientX - last[0]) * scale, dy = (event.clientY - last[1]) * scale;
    last = [event.clientX, event.clientY];
    if (event.shiftKey) {
      place(5, offsets[5] + 0.25 * dx * data.degrees_per_pixel);
    } else if (event.ctrlKey || event.altKey) {
      // Objects 10 m away follow the mouse.
      const cm = 1000 * data.degrees_per_pixel * Math.PI / 180;
      place(0, offsets[0] - dx * cm);
      place(1, offsets[1] - dy * cm);
    } else {
      place(4, offsets[4] + dx * data.degrees_per_pixel);
      place(3, offsets[3] - dy * data.degrees_per_pixel);
    }
  });
  for (const end of ["pointerup", "pointercancel"]) image.addEventListener(end, () => { last = null; });
  image.addEventListener("keydown", (event) => {
    const turns = { ArrowLeft: [4, -1], ArrowRight: [4, 1], ArrowUp: [3, 1], ArrowDown: [3, -1] };
    if (!turns[event.key]) return;
    event.preventDefault();
    const [axis, sign] = turns[event.key];
    place(axis, offsets[axis] + sign * KEY_STEP_PX * data.degrees_per_pixel);
  });
  image.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    place(2, offsets[2] - 0.02 * event.deltaY);
  }, { passive: false });

  // Edges of the sweep are drawn on edges of the image.
  function showBackground() {
    const byEdge = chosen("colors") === "edge", source = `${byEdge ? "edges" : "image"}/${frame}`;
    if (background.getAttribute("src") !== source) background.src = source;
    image.classList.toggle("edges", byEdge);
    image.classList.toggle("photograph", !byEdge && data.is_photograph[frame]);
  }
  function showFrame(number) {
    frame = Math.min(data.frames.length - 1, Math.max(0, number));
    byId("frame").value = frame;
    points = null;
    if (picked) {
      picked.mark.remove();
      picked = null;
    }
    showBackground();
    showSweep();
    update();
  }
  byId("frame").addEventListener("input", (event) => showFrame(Number(event.target.value)));
  byId("previous").addEventListener("click", () => showFrame(frame - 1));
  byId("next").addEventListener("click", () => showFrame(frame + 1));

  const choose = () => {
    for (const legend of document.querySelectorAll("[data-colors]")) legend.hidden = legend.dataset.colors !== chosen("colors");
    showBackground();
    draw();
  };
  for (const input of document.querySelectorAll("input[name=colors]")) input.addEventListener("change", choose);
  addEventListener("resize", () => { draw(); drawCourse(); });

  byId("reset").addEventListener("click", () => {
    leave();
    begin(base);
  });
  byId("back").addEventListener("click", () => {
    const before = poses.pop();
    begin(before.base);
    before.offsets.forEach((value, i) => place(i, value));
  });
  const mounting = byId("mounting");
  if (mounting) mounting.addEventListener("change", () => {
    leave();
    begin(data.mountings[mounting.value]);
  });

  // Buttons are disabled during what takes a while or ends the page.
  const buttons = ["refine", "save", "end", "back", "reset"].map(byId).filter(Boolean);
  async function during(doing, work) {
    tell(doing);
    for (const button of buttons) button.disabled = true;
    try {
      await work();
    } catch (error) {
      tell(error.message, "error");
    } finally {
      for (const button of buttons) button.disabled = button.id === "back" && poses.length === 0;
    }
  }
  const onClick = (id, doing, work) => byId(id) && byId(id).addEventListener("click", () => during(doing, work));
  onClick("refine", "Refining, which takes seconds to a minute.", async () => {
    const found = await ask("refine", asked());
    leave();
    begin(found.T);
    tell([`${found.title}. ${found.figures}`, ...found.reasons].join("\n"), found.status);
  });
  byId("use-pairs").addEventListener("click", async () => {
    try {
      const found = await ask("pairs", { ...asked(), pairs });
      leave();
      begin(found.T);
      tell(`${pairs.length} pairs: the farthest point is ${found.error_px.toFixed(1)} pixels from its pixel.`);
    } catch (error) {
      tell(error.message, "error");
    }
  });
  const saved = (found) => {
    if (found.path === null) {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(new Blob([found.text], { type: "application/yaml" }));
      link.download = "init.yaml";
      link.click();
      URL.revokeObjectURL(link.href);
    }
    return found.path || "init.yaml";
  };
  onClick("save", "Saving.", async () => tell(`Saved to ${saved(await ask("save", asked()))}. Give it to semcal calibrate with --init.`));
  onClick("end", "Saving.", async () => {
    saved(await ask("end", asked()));
    document.body.textContent = `Saved to ${data.saves_to}. The server has stopped; you can close this page.`;
  });

  reach();
  choose();
  showFrame(0);
})();
