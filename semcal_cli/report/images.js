// The images of a page, which are drawn when they come into view, and again when the colours change.
(() => {
  const data = JSON.parse(document.getElementById("pictures-data").textContent);
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
  const windowOf = (picture) => {
    const { width, height, window } = picture.dataset;
    const [left, top, wide, high] = window ? window.split(" ").map(Number) : [0, 0, 1, 1];
    return [left * width, top * height, wide * width, high * height];
  };
  // A magnified part shows the image of its frame again.
  const magnify = async (canvas, picture, [left, top, wide, high]) => {
    const image = document.querySelector(`#frame-${picture.dataset.frame} img`);
    await image.decode();
    const scale = image.naturalWidth / picture.dataset.width;
    canvas.width = 2 * canvas.clientWidth;
    canvas.height = 2 * canvas.clientHeight;
    canvas.getContext("2d").drawImage(
      image, left * scale, top * scale, wide * scale, high * scale, 0, 0, canvas.width, canvas.height);
  };
  const show = (picture) => {
    const points = pointsOf(picture.dataset.frame), window = windowOf(picture);
    const ground = picture.querySelector("canvas.ground");
    if (ground) magnify(ground, picture, window);
    for (const canvas of picture.querySelectorAll("canvas[data-pose]")) {
      Points.draw(canvas, points, Number(canvas.dataset.pose), picture.dataset.colorsOf || chosen(), colors, window);
    }
  };

  const pictures = [...document.querySelectorAll(".picture")], visible = new Set();
  for (const picture of pictures) {
    const slider = picture.querySelector("input[type=range]");
    if (slider) slider.addEventListener("input", () => picture.style.setProperty("--at", `${slider.value}%`));
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
  for (const picture of pictures) watcher.observe(picture);
  const choose = () => {
    for (const legend of document.querySelectorAll("[data-colors]")) legend.hidden = legend.dataset.colors !== chosen();
    for (const picture of visible) show(picture);
  };
  for (const choice of choices) choice.addEventListener("change", choose);
  addEventListener("resize", () => visible.forEach(show));
  addEventListener("beforeprint", () => pictures.forEach(show));
  choose();
})();
