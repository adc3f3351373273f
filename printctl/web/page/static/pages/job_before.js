import { html } from "../ui.js";
export default ({ job }) => html`<p>${job}</p>`;
