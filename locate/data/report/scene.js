(() => {
  const figure = JSON.parse(document.getElementById("figure").textContent);
  const place = document.getElementById("view");
  const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const themed = () => {
    const layout = structuredClone(figure.layout);
    layout.font = { family: "system-ui, sans-serif", size: 12, color: color("--quiet") };
    for (const axis of ["xaxis", "yaxis", "zaxis"]) {
      Object.assign(layout.scene[axis], { gridcolor: color("--line"), zerolinecolor: color("--line"), linecolor: color("--line") });
    }
    for (const menu of layout.updatemenus) {
      Object.assign(menu, { bgcolor: color("--card"), bordercolor: color("--line"), font: { color: color("--quiet") } });
    }
    return layout;
  };
  const config = { responsive: true, displaylogo: false, modeBarButtons: [["toImage", "zoom3d", "pan3d", "tableRotation", "resetCameraDefault3d"]] };
  Plotly.newPlot(place, figure.data, themed(), config);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => Plotly.react(place, figure.data, themed(), config));
})();
