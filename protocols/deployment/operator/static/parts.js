// Small parts that forms are made of.

/** Make an element of *kind* with properties; `children` are put into it, `dataset` and `aria` are taken apart. */
export function make(kind, { children = [], dataset = {}, aria = {}, ...properties } = {}) {
  const made = Object.assign(document.createElement(kind), properties);
  Object.assign(made.dataset, dataset);
  for (const [name, value] of Object.entries(aria)) made.setAttribute(`aria-${name}`, String(value));
  made.append(...children);
  return made;
}

/** Make a button that does something. */
export function button(text, act, more = {}) {
  const made = make("button", { type: "button", textContent: text, ...more });
  made.addEventListener("click", () => act(made));
  return made;
}

/** Make a choice of [value, text] pairs. */
export function choice(pairs, value, changed, more = {}) {
  const made = make("select", more);
  for (const [each, text] of pairs) made.add(new Option(text, each, each === value, each === value));
  made.addEventListener("change", () => changed(made.value));
  return made;
}

/** Make a field for a number; `changed` is called with the number, or null if there is none. */
export function number(value, changed, more = {}) {
  const made = make("input", { type: "number", step: "any", value: value ?? "", ...more });
  made.addEventListener("input", () => changed(made.value === "" ? null : Number(made.value)));
  return made;
}

/** Put a label in front of a field, or around a group of them. */
export function labelled(text, field, about = "") {
  const single = field.matches("input, select");
  const made = make(single ? "label" : "div", { className: "field", title: about });
  const title = make("span", { className: "title", textContent: text });
  made.append(title, field);
  if (!single) {
    field.setAttribute("role", "group");
    field.setAttribute("aria-label", text);
  }
  return made;
}

/** A place in words: its name, or its coordinates. */
export function place_text(place) {
  return typeof place === "string" ? place : `${short(place[0])}, ${short(place[1])}`;
}

/** A number with as many decimals as a person can use. */
export function short(value) {
  return String(Number(value.toFixed(2)));
}

/** A span of time in words. */
export function seconds(value) {
  if (value === null || value === undefined) return "any time";
  return value < 100 ? `${Number(value.toFixed(1))} s` : `${Math.round(value)} s`;
}

/** Duration of a plan, in words, by an answer's `expected_s`, null if that is unknown, and its windows. */
export function duration({ plan, expected_s, windows }) {
  if (expected_s !== null) return `about ${seconds(expected_s)}`;
  const least_s = windows?.[plan.root.name]?.[2];
  return least_s ? `time unknown, at least ${seconds(least_s)}` : "time unknown";
}
