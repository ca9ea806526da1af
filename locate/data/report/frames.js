(() => {
  const figures = [...document.querySelectorAll(".frames figure")];
  const choices = [...document.querySelectorAll("#chosen-plume button")];
  const viewer = document.getElementById("viewer");
  if (!viewer) return;
  const picture = document.getElementById("viewer-picture");
  const caption = document.getElementById("viewer-caption");
  let shown = null;

  const choosePlume = (plume) => {
    for (const button of choices) button.setAttribute("aria-pressed", button.dataset.plume === plume);
    for (const figure of figures) figure.hidden = plume !== "" && !figure.dataset.plumes.split(" ").includes(plume);
  };

  const open = (figure) => {
    shown = figure;
    picture.style.setProperty("--shape", figure.style.getPropertyValue("--shape"));
    picture.replaceChildren(...[...figure.querySelectorAll(".stack")].map((stack) => stack.cloneNode(true)));
    const visible = figures.filter((one) => !one.hidden);
    caption.textContent = `${figure.querySelector("figcaption").textContent} (${visible.indexOf(figure) + 1} of ${visible.length})`;
    if (!viewer.open) viewer.showModal();
  };

  const step = (by) => {
    const visible = figures.filter((one) => !one.hidden);
    const next = visible[visible.indexOf(shown) + by];
    if (next) open(next);
  };

  const close = () => {
    viewer.close();
    shown.querySelector("button").focus();
  };

  for (const figure of figures) figure.querySelector("button").addEventListener("click", () => open(figure));
  for (const button of choices) button.addEventListener("click", () => choosePlume(button.dataset.plume));
  for (const button of viewer.querySelectorAll("[data-step]")) button.addEventListener("click", () => step(Number(button.dataset.step)));
  viewer.querySelector("[data-close]").addEventListener("click", close);
  viewer.addEventListener("click", (event) => { if (event.target === viewer) close(); });
  viewer.addEventListener("keydown", (event) => {
    if (event.key === "ArrowLeft") step(-1);
    else if (event.key === "ArrowRight") step(1);
  });

  document.addEventListener("choose-plume", (event) => {
    choosePlume(String(event.detail));
    document.getElementById("frames").scrollIntoView({ behavior: "smooth" });
  });
  document.addEventListener("open-frame", (event) => {
    const away = (figure) => Math.abs(Number(figure.dataset.frame) - event.detail);
    choosePlume("");
    open(figures.reduce((best, figure) => (away(figure) < away(best) ? figure : best)));
  });
})();
