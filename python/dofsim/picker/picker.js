// Controls write one request; frames answer it. Every request is the whole state, numbered, so that any of them may
// be left out: ipywidgets keeps back all but the newest while the kernel is busy.

const NAMES = { picture: "picture", coc: "blur (near red, far blue)", outline: "sharp zone" };

function element(tag, words = {}, children = []) {
  const made = Object.assign(document.createElement(tag), words);
  made.append(...children);
  return made;
}

/** Shows bytes in an image, and gives back the memory of what was shown before. */
function show(image, bytes) {
  const before = image.src;
  image.hidden = !bytes;
  if (bytes) {
    image.src = URL.createObjectURL(new Blob([bytes], { type: "image/png" }));
  } else {
    image.removeAttribute("src");
  }
  if (before.startsWith("blob:")) URL.revokeObjectURL(before);
}

function render({ model, el }) {
  const { size, stops, hasBlades, overlays } = model.get("_setup");
  const [width, height] = size;
  let shownNumber = -1;
  let pressed = false;
  let wiped = 0;

  const ask = (change, dragging) => {
    const request = model.get("_request");
    model.set("_request", { ...request, ...change, dragging, number: request.number + 1 });
    model.save_changes();
  };

  // The picture, the pinhole picture wiped over it, what is laid over both, and where the focus is.
  const picture = element("img", { draggable: false });
  const pinhole = element("img", { alt: "", draggable: false });
  const overlay = element("img", { alt: "", draggable: false, hidden: true });
  const edge = element("div", { className: "edge", hidden: true });
  const point = element("div", { className: "point", hidden: true });
  const stage = element("div", { className: "stage", tabIndex: 0 }, [picture, pinhole, overlay, edge, point]);
  stage.style.aspectRatio = `${width} / ${height}`;
  stage.setAttribute("role", "application");
  stage.setAttribute("aria-label", "Picture. Click, or use the arrow keys, to choose what is in focus.");

  const clamp = (value, end) => Math.min(Math.max(Math.floor(value), 0), end - 1);
  const pixelAt = (event) => {
    const box = stage.getBoundingClientRect();
    return [
      clamp(((event.clientX - box.left) / box.width) * width, width),
      clamp(((event.clientY - box.top) / box.height) * height, height),
    ];
  };
  stage.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    pressed = true;
    stage.setPointerCapture(event.pointerId);
    ask({ focus: pixelAt(event) }, true);
  });
  stage.addEventListener("pointermove", (event) => pressed && ask({ focus: pixelAt(event) }, true));
  const release = (event) => {
    if (!pressed) return;
    pressed = false;
    ask(event.type === "pointerup" ? { focus: pixelAt(event) } : {}, false);
  };
  stage.addEventListener("pointerup", release);
  stage.addEventListener("pointercancel", release);

  const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  stage.addEventListener("keydown", (event) => {
    const arrow = ARROWS[event.key];
    if (!arrow) return;
    event.preventDefault();
    event.stopPropagation();
    const step = Math.max(1, Math.round(Math.max(width, height) * (event.shiftKey ? 0.05 : 0.01)));
    const [x, y] = model.get("_request").focus ?? [width >> 1, height >> 1];
    ask({ focus: [clamp(x + step * arrow[0], width), clamp(y + step * arrow[1], height)] }, true);
  });
  stage.addEventListener("keyup", (event) => ARROWS[event.key] && ask({}, false));

  // A slider asks for previews while it moves, and for the whole picture when it is let go.
  const slider = (name, text, [low, high, step], write) => {
    const input = element("input", { type: "range", min: low, max: high, step, name });
    const value = element("span", { className: "value" });
    const update = () => {
      input.value = model.get("_request")[name];
      value.textContent = write(Number(input.value));
      input.setAttribute("aria-valuetext", value.textContent);
    };
    input.addEventListener("input", () => ask({ [name]: Number(input.value) }, true));
    input.addEventListener("change", () => ask({ [name]: Number(input.value) }, false));
    return { label: element("label", {}, [text, input, value]), update };
  };
  const signed = (value) => {
    const sign = value > 0 ? "+" : value < 0 ? "\u2212" : "";
    return sign + Math.abs(value).toFixed(2).replace(/\.?0+$/, "");
  };
  const sliders = [
    slider("stops", "opening", [...stops, 0.25], (value) => `${signed(value)} stops`),
    ...(hasBlades
      ? [slider("blades", "blades", [2, 12, 1], (value) => (value < 3 ? "round" : String(value)))]
      : []),
    slider("exposure", "exposure", [-4, 4, 0.25], (value) => `${signed(value)} EV`),
  ];

  const wipe = element("input", { type: "range", min: 0, max: 100, step: 1, value: 0, name: "wipe" });
  wipe.setAttribute("aria-valuetext", "only the picture through the lens");
  wipe.addEventListener("input", () => {
    wiped = Number(wipe.value);
    wipe.setAttribute("aria-valuetext", `the pinhole picture on ${wiped} per cent`);
    drawWipe();
  });
  const drawWipe = () => {
    pinhole.style.clipPath = `inset(0 ${100 - wiped}% 0 0)`;
    edge.hidden = wiped === 0 || wiped === 100;
    edge.style.left = `${wiped}%`;
  };

  const choices = overlays.map((value) => element("option", { value, textContent: NAMES[value] }));
  const choice = element("select", { name: "overlay" }, choices);
  choice.addEventListener("change", () => ask({ overlay: choice.value }, false));

  const readout = element("div", { className: "readout" });
  readout.setAttribute("role", "status");
  const code = element("code", { title: "The lens, to be pasted" });
  const controls = element("div", { className: "controls" }, [
    ...sliders.map((one) => one.label),
    element("label", {}, ["before / after", wipe]),
    element("label", {}, ["show", choice]),
  ]);
  const root = element("div", { className: "dofsim-picker" }, [stage, controls, readout, code]);
  // JupyterLab would take the arrow keys of whatever has the focus for its own.
  for (const control of root.querySelectorAll("[tabindex], input, select")) {
    control.dataset.lmSuppressShortcuts = "true";
  }

  const drawRequest = () => {
    const { focus, overlay: chosen, number } = model.get("_request");
    root.dataset.asked = number;
    sliders.forEach((one) => one.update());
    choice.value = chosen;
    point.hidden = !focus;
    if (focus) {
      point.style.left = `${(100 * (focus[0] + 0.5)) / width}%`;
      point.style.top = `${(100 * (focus[1] + 0.5)) / height}%`;
    }
  };
  const drawFrame = () => {
    const frame = model.get("_frame");
    // A frame of an earlier request than the one that is shown is stale.
    if (frame.number === undefined || frame.number < shownNumber) return;
    shownNumber = frame.number;
    show(picture, frame.picture);
    show(pinhole, frame.pinhole);
    show(overlay, frame.overlay);
    picture.alt = frame.alt;
    readout.textContent = frame.readout;
    code.textContent = frame.repr;
    root.dataset.number = frame.number;
    root.dataset.full = frame.full;
  };
  model.on("change:_request", drawRequest);
  model.on("change:_frame", drawFrame);

  el.append(root);
  drawWipe();
  drawRequest();
  drawFrame();
  if (shownNumber < 0) ask({}, false);

  return () => {
    model.off("change:_request", drawRequest);
    model.off("change:_frame", drawFrame);
    for (const image of [picture, pinhole, overlay]) show(image, null);
  };
}

export default { render };
