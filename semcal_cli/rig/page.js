showCloud(
  document.getElementById("cloud-view"),
  JSON.parse(document.getElementById("cloud-data").textContent),
  document.getElementById("cloud-colors"),
);
