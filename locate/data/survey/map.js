(() => {
  const map = document.getElementById("map");
  const whole = map.getAttribute("viewBox").split(" ").map(Number);
  let view = [...whole];
  const show = () => map.setAttribute("viewBox", view.join(" "));
  const scale = () => Math.max(view[2] / map.clientWidth, view[3] / map.clientHeight);
  const inMetres = (event) => {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(map.getScreenCTM().inverse());
    return [point.x, point.y];
  };
  map.addEventListener("wheel", (event) => {
    event.preventDefault();
    const [x, y] = inMetres(event), zoom = Math.exp(event.deltaY / 400);
    view = [x + (view[0] - x) * zoom, y + (view[1] - y) * zoom, view[2] * zoom, view[3] * zoom];
    show();
  }, { passive: false });
  map.addEventListener("pointerdown", (event) => map.setPointerCapture(event.pointerId));
  map.addEventListener("pointermove", (event) => {
    if (!event.buttons) return;
    view[0] -= event.movementX * scale();
    view[1] -= event.movementY * scale();
    show();
  });
  map.addEventListener("dblclick", () => { view = [...whole]; show(); });
  for (const choice of document.querySelectorAll(".choices input")) {
    choice.addEventListener("change", () => {
      for (const layer of document.querySelectorAll(".layer")) {
        layer.classList.toggle("shown", (layer.dataset.layer ?? layer.id) === choice.value);
      }
    });
  }
})();
