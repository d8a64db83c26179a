"use strict";
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
