for (const slider of document.querySelectorAll(".compare input")) {
  slider.addEventListener("input", () => {
    slider.closest(".compare").style.setProperty("--at", slider.value + "%");
  });
}
