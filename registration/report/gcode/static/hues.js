// The page's colours that a canvas is drawn in.
const NAMES = ["paper", "ink", "muted", "way", "lifted", "prime", "retract", "rim", "ground"];

export function hues() {
  const style = getComputedStyle(document.documentElement);
  const said = (name) => style.getPropertyValue(`--${name}`).trim();
  return { ...Object.fromEntries(NAMES.map((name) => [name, said(name)])), mark: said("hot") };
}
