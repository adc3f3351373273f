// What the operator fills in for a print, as fields (Fields in ui.js); History shows them by the same names.
const text = (name, label) => ({ name, label, maxlength: 200 });
const figure = (name, label, unit, step = "any") => ({ name, label, unit, step, kind: "number", min: 0 });
export const RECORD = [
  text("operator", "Operator's name"), text("ink_lot", "Lot of the ink"), text("bath_lot", "Lot and age of the bath"),
  text("needle_lot", "Lot of the needle"), text("cells", "Cells (line or donor)"),
  figure("passage", "Passage", "", 1), figure("density_per_ml", "Cells per mL of ink", "/mL"),
  figure("viability_percent", "Viability when mixed", "%"), figure("viability_min", "Time the cells have", "min"),
];
