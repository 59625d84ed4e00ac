// The legend of the kinds, by groups: a click on one hides its boxes, or shows them again.

import { element } from "../dom.js";

const TITLES = { frame: "Frames", state: "States", message: "Messages", wake: "Wakes", event: "Events" };

/** Fill *root* with a switch for each kind; *changed* is called after each change of what is hidden. */
export function show_legend(root, kinds, changed) {
  const groups = Map.groupBy(kinds.by_code.values(), ({ group }) => group);
  root.replaceChildren();
  for (const [group, members] of groups) {
    const switches = members.map((kind) => toggle(kind, kinds, changed));
    root.append(
      element("h3", {}, TITLES[group] ?? group),
      element("ul", { className: `tl-kinds tl-kinds-${group}` }, ...switches),
    );
  }
  root.append(element("p", { className: "tl-key" }, element("span", { className: "tl-lost", "aria-hidden": "true" }),
    " lost: hatched is the lost part, or all; thin: nothing to say; above a line: sent; below: received; by channel: grey is left out by adaptive hopping, "
    + "hatched is jammed; bars at the right: share of lost frames; piconets: a line on top is a robot in two of them, hatched is one "
    + "that is not there, or not all the time"));
}

function toggle({ code, name, meaning }, kinds, changed) {
  const chip = element("span", { className: "tl-chip", "aria-hidden": "true" });
  chip.style.background = kinds.colour(code);
  const button = element("button", { type: "button", title: meaning }, chip, ` ${name.replaceAll("_", " ")}`);
  button.setAttribute("aria-pressed", String(!kinds.hidden.has(code)));
  button.addEventListener("click", () => {
    if (!kinds.hidden.delete(code)) kinds.hidden.add(code);
    button.setAttribute("aria-pressed", String(!kinds.hidden.has(code)));
    changed();
  });
  return element("li", {}, button);
}
