(() => {
  const figure = JSON.parse(document.getElementById("figure").textContent);
  const place = document.getElementById("view");
  const printed = document.getElementById("printed-view");
  const buttons = [...document.querySelectorAll("#close-ups button")];
  const narrow = matchMedia("(max-width: 40rem)");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const config = { responsive: true, displaylogo: false, modeBarButtons: [["toImage", "zoom3d", "pan3d", "tableRotation", "resetCameraDefault3d"]] };
  const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  const layoutIn = (quiet, line) => {
    const layout = structuredClone(figure.layout);
    layout.font = { family: "system-ui, sans-serif", size: 12, color: quiet };
    layout.showlegend = !narrow.matches;
    for (const axis of ["xaxis", "yaxis", "zaxis"]) {
      Object.assign(layout.scene[axis], { gridcolor: line, zerolinecolor: line, linecolor: line });
      if (narrow.matches) Object.assign(layout.scene[axis], { nticks: 4, tickfont: { size: 10 } });
    }
    if (narrow.matches) for (const side of ["x", "y", "z"]) layout.scene.camera.eye[side] *= 1.4;
    return layout;
  };

  const draw = () => {
    const layout = layoutIn(color("--quiet"), color("--line"));
    return Plotly.react(place, figure.data, layout, config);
  };

  // Browsers print WebGL as it happens to be, often empty: a picture of the scene stands in for it.
  const picture = async () => {
    const layout = layoutIn("#5a606b", "#dcdfe4");
    const { camera, aspectratio, xaxis, yaxis, zaxis } = place.layout.scene;
    Object.assign(layout.scene, { camera, aspectratio });
    for (const [name, axis] of Object.entries({ xaxis, yaxis, zaxis })) layout.scene[name].range = axis.range;
    printed.src = await Plotly.toImage({ data: figure.data, layout, config }, { format: "png", width: 1000, height: 640 });
  };
  let waiting = 0;
  const pictureSoon = () => {
    clearTimeout(waiting);
    waiting = setTimeout(picture, 800);
  };

  const announce = (name, detail) => document.dispatchEvent(new CustomEvent(name, { detail }));
  const clicked = ({ points: [point] }) => {
    const { click } = point.data.meta ?? {};
    if (click === "plume") announce("choose-plume", point.customdata ?? point.data.meta.plume);
    if (click === "frame") announce("open-frame", point.customdata);
  };

  draw().then(() => {
    place.on("plotly_click", clicked);
    place.on("plotly_relayout", pictureSoon);
    pictureSoon();
  });
  for (const button of buttons) {
    button.addEventListener("click", () => {
      for (const other of buttons) other.setAttribute("aria-pressed", other === button);
      Plotly.relayout(place, figure.close_ups[button.textContent]);
    });
  }
  dark.addEventListener("change", draw);
  narrow.addEventListener("change", draw);
})();
