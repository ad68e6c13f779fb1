// The images of a page, which are drawn when they come into view, and again when the colours change.
(() => {
  const data = JSON.parse(document.getElementById("images-data").textContent);
  const colors = Points.tables(data.palette);
  const choices = [...document.querySelectorAll("input[name=colors]")];
  const chosen = () => choices.find((each) => each.checked).value;
  const unpacked = new Map();
  const pointsOf = (number) => {
    if (!unpacked.has(number)) {
      unpacked.set(number, Points.unpack(JSON.parse(document.getElementById(`points-${number}`).textContent)));
    }
    return unpacked.get(number);
  };

  // The part of its frame that an image shows, in pixels.
  const windowOf = (image) => {
    const { width, height, window } = image.dataset;
    const [left, top, wide, high] = window ? window.split(" ").map(Number) : [0, 0, 1, 1];
    return [left * width, top * height, wide * width, high * height];
  };
  // A magnified part shows the image of its frame again.
  const magnify = async (canvas, image, [left, top, wide, high]) => {
    const photograph = document.querySelector(`#frame-${image.dataset.frame} img`);
    await photograph.decode();
    const scale = photograph.naturalWidth / image.dataset.width;
    canvas.width = 2 * canvas.clientWidth;
    canvas.height = 2 * canvas.clientHeight;
    canvas.getContext("2d").drawImage(
      photograph, left * scale, top * scale, wide * scale, high * scale, 0, 0, canvas.width, canvas.height);
  };
  const show = (image) => {
    const points = pointsOf(image.dataset.frame), window = windowOf(image);
    const ground = image.querySelector("canvas.ground");
    if (ground) magnify(ground, image, window);
    for (const canvas of image.querySelectorAll("canvas[data-pose]")) {
      Points.draw(canvas, points, Number(canvas.dataset.pose), image.dataset.colorsOf || chosen(), colors, window);
    }
  };

  const images = [...document.querySelectorAll(".image")], visible = new Set();
  for (const image of images) {
    const slider = image.querySelector("input[type=range]");
    if (slider) slider.addEventListener("input", () => image.style.setProperty("--at", `${slider.value}%`));
  }
  const watcher = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      if (!isIntersecting) {
        visible.delete(target);
      } else if (!visible.has(target)) {
        visible.add(target);
        show(target);
      }
    }
  }, { rootMargin: "400px" });
  for (const image of images) watcher.observe(image);
  // Edges of the sweep are drawn on edges of the image, and other colours on the photograph.
  const showGround = (image) => {
    const ground = image.querySelector("img[data-photograph]");
    if (!ground) return;
    const byEdge = chosen() === "edge";
    ground.dataset.edges = ground.dataset.edges || ground.src;
    ground.src = byEdge ? ground.dataset.edges : ground.dataset.photograph;
    image.classList.toggle("edges", byEdge);
    image.classList.toggle("photograph", !byEdge);
  };
  const choose = () => {
    images.forEach(showGround);
    for (const legend of document.querySelectorAll("[data-colors]")) legend.hidden = legend.dataset.colors !== chosen();
    for (const image of visible) show(image);
  };
  for (const choice of choices) choice.addEventListener("change", choose);
  addEventListener("resize", () => visible.forEach(show));
  addEventListener("beforeprint", () => images.forEach(show));
  choose();
})();
