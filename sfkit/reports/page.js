(() => {
  "use strict";

  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const LOOKS = {
    light: { ink: "#1f2328", paper: "#ffffff", grid: "#d1d9e0", line: "#9198a1" },
    dark: { ink: "#e6edf3", paper: "#14181d", grid: "#3d444d", line: "#59636e" },
  };

  /**
   * A figure's layout on this page: the page's paper and ink replace the figure's own, since one without the
   * other may be unreadable; lines change in the template only, so that lines the author chose stay.
   *
   * @param {object} layout a plotly layout; not changed
   * @param {{ink: string, paper: string, grid: string, line: string}} look the page's colours
   * @returns {object} a layout of the same figure
   */
  function onPage(layout, look) {
    const template = layout.template ?? {};
    const base = template.layout ?? {};
    const lines = { gridcolor: look.grid, linecolor: look.line, zerolinecolor: look.line, tickcolor: look.line };
    /** The named axes of a part of the layout, with the page's lines. */
    const relined = (part, axes, more = {}) => ({
      ...part,
      ...Object.fromEntries(axes.map((axis) => [axis, { ...part?.[axis], ...lines, ...more }])),
    });
    return {
      ...layout,
      template: {
        ...template,
        layout: {
          ...relined(base, ["xaxis", "yaxis"]),
          polar: { ...relined(base.polar, ["angularaxis", "radialaxis"]), bgcolor: look.paper },
          scene: relined(base.scene, ["xaxis", "yaxis", "zaxis"], { backgroundcolor: look.paper }),
        },
      },
      font: { ...layout.font, color: look.ink },
      height: layout.height ?? 450,
      paper_bgcolor: look.paper,
      plot_bgcolor: look.paper,
    };
  }

  /** Draw every figure of the page in the colours the reader asks for. */
  function draw() {
    for (const holder of document.querySelectorAll(".figure")) {
      const figure = JSON.parse(holder.querySelector("script").textContent);
      Plotly.newPlot(holder.querySelector(".plot"), {
        data: figure.data,
        frames: figure.frames ?? [],
        layout: onPage(figure.layout ?? {}, dark.matches ? LOOKS.dark : LOOKS.light),
        config: { responsive: true, displaylogo: false },
      });
    }
  }

  dark.addEventListener("change", draw);
  draw();
})();
