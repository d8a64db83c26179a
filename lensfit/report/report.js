"use strict";
(() => {
  for (const figure of document.querySelectorAll(".wipe")) {
    const pair = figure.querySelector(".pair");
    const stage = figure.querySelector(".stage");
    const slider = figure.querySelector("input");
    const large = figure.querySelector(".wiper button");
    const wipe = () => stage.style.setProperty("--wipe", slider.value + "%");
    const follow = (event) => {
      const box = stage.getBoundingClientRect();
      slider.value = (100 * (event.clientX - box.left)) / box.width;
      wipe();
    };
    pair.classList.add("live");
    figure.querySelector(".wiper").hidden = false;
    slider.addEventListener("input", wipe);
    stage.addEventListener("pointerdown", (event) => {
      stage.setPointerCapture(event.pointerId);
      follow(event);
    });
    stage.addEventListener("pointermove", (event) => {
      if (event.buttons) follow(event);
    });
    large.addEventListener("click", () => {
      const full = pair.classList.toggle("full");
      large.setAttribute("aria-pressed", full);
      pair.scrollLeft = (pair.scrollWidth - pair.clientWidth) / 2;
      pair.scrollTop = (pair.scrollHeight - pair.clientHeight) / 2;
    });
    wipe();
  }
})();
(() => {
  const dialog = document.querySelector("dialog");
  if (!dialog || !dialog.showModal) return;
  const large = dialog.querySelector("img");
  for (const button of document.querySelectorAll("button.zoom")) {
    button.addEventListener("click", () => {
      const small = button.querySelector("img");
      large.src = small.src;
      large.alt = small.alt;
      dialog.classList.remove("full");
      dialog.showModal();
    });
  }
  large.addEventListener("click", (event) => {
    const x = event.offsetX / large.clientWidth;
    const y = event.offsetY / large.clientHeight;
    dialog.classList.toggle("full");
    dialog.scrollTo(
      x * large.clientWidth - dialog.clientWidth / 2,
      y * large.clientHeight - dialog.clientHeight / 2,
    );
    event.stopPropagation();
  });
  dialog.addEventListener("click", () => dialog.close());
})();
