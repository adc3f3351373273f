// The live view as a component of a NiceGUI page; see live_view.js.
const root = () => window.path_prefix ?? "";

function addStyle(href) {
  if (document.querySelector(`link[href="${href}"]`)) return;
  const link = document.createElement("link");
  Object.assign(link, { rel: "stylesheet", href });
  document.head.append(link);
}

export default {
  template: "<div></div>",
  props: { scene: String, live: Boolean },
  async mounted() {
    addStyle(`${root()}/live/static/live_view.css`);
    const { liveView } = await import(`${root()}/live/static/live_view.js`);
    const view = await liveView(this.$el, { scene: root() + this.scene, live: this.live });
    if (this.gone) view.dispose();
    this.view = view;
    if (this.waiting) view.update(this.waiting);
  },
  beforeUnmount() {
    this.gone = true;
    this.view?.dispose();
  },
  methods: {
    update(news) {
      if (this.view) this.view.update(news);
      else this.waiting = { ...this.waiting, ...news };
    },
  },
};
