showCloud(
  document.getElementById("cloud-view"),
  JSON.parse(document.getElementById("cloud-data").textContent),
  document.getElementById("cloud-colors"),
);

// Printed, what is folded is opened.
addEventListener("beforeprint", () => {
  for (const details of document.querySelectorAll("details:not([open])")) {
    details.open = true;
    details.dataset.opened = "";
  }
});
addEventListener("afterprint", () => {
  for (const details of document.querySelectorAll("details[data-opened]")) {
    details.open = false;
    delete details.dataset.opened;
  }
});
