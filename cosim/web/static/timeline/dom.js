// Making elements.

/** An element with properties, attributes (those with a hyphen, role, class) and children. */
export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name in made && !name.includes("-") && name !== "role") made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

/** A table of rows whose first cell is their heading; *heads* of the columns are optional. */
export function table(caption, heads, rows) {
  const made = element("table", {}, element("caption", {}, caption));
  if (heads) {
    made.append(element("thead", {}, element("tr", {}, ...heads.map((head) => element("th", { scope: "col" }, head)))));
  }
  const lines = rows.map(([first, ...rest]) =>
    element("tr", {}, element("th", { scope: "row" }, first), ...rest.map((text) => element("td", {}, text))));
  made.append(element("tbody", {}, ...lines));
  return made;
}
