// Buttons that enlarge the pictures of a page. An enlarged picture is scrolled in its frame; a double
// click enlarges it about the point.
"use strict";
for (const view of document.querySelectorAll("figure .view")) {
  const picture = view.querySelector("img");
  let factor = 1;

  function enlarge(by, x = view.clientWidth / 2, y = view.clientHeight / 2) {
    const before = [picture.clientWidth, picture.clientHeight];
    const at = [(view.scrollLeft + x) / before[0], (view.scrollTop + y) / before[1]];
    factor = by === 0 ? 1 : Math.min(8, Math.max(1, factor * by));
    picture.style.width = `${100 * factor}%`;
    picture.style.minWidth = by === 0 ? "0" : `${40 * factor}rem`;
    view.scrollLeft = at[0] * picture.clientWidth - x;
    view.scrollTop = at[1] * picture.clientHeight - y;
    view.dataset.factor = factor;
  }

  const tools = document.createElement("div");
  tools.className = "tools figure-tools";
  for (const [sign, words, by] of [["−", "smaller", 1 / 1.5], ["+", "larger", 1.5], ["⤢", "whole picture", 0]]) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = sign;
    button.title = words;
    button.setAttribute("aria-label", words);
    button.addEventListener("click", () => enlarge(by));
    tools.append(button);
  }
  view.before(tools);
  view.addEventListener("dblclick", (event) => {
    const frame = view.getBoundingClientRect();
    enlarge(2, event.clientX - frame.left, event.clientY - frame.top);
  });
}
