(() => {
  "use strict";

  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const INK = "#e6edf3";
  const PAPER = "#14181d";
  const LINES = { gridcolor: "#3d444d", linecolor: "#59636e", zerolinecolor: "#59636e", tickcolor: "#59636e" };

  /**
   * The layout for a dark page: dark paper and light ink replace the figure's own, since one without the
   * other cannot be read; lines change in the template only, so that lines the author chose stay.
   *
   * @param {object} layout a plotly layout; not changed
   * @returns {object} a layout of the same figure
   */
  function darkened(layout) {
    const template = layout.template ?? {};
    const look = { ...(template.layout ?? {}) };
    for (const axis of ["xaxis", "yaxis"]) {
      look[axis] = { ...look[axis], ...LINES };
    }
    look.polar = {
      ...look.polar,
      bgcolor: PAPER,
      angularaxis: { ...look.polar?.angularaxis, ...LINES },
      radialaxis: { ...look.polar?.radialaxis, ...LINES },
    };
    const scene = {};
    for (const axis of ["xaxis", "yaxis", "zaxis"]) {
      scene[axis] = { ...look.scene?.[axis], ...LINES, backgroundcolor: PAPER };
    }
    look.scene = { ...look.scene, ...scene };
    return {
      ...layout,
      template: { ...template, layout: look },
      paper_bgcolor: PAPER,
      plot_bgcolor: PAPER,
      font: { ...layout.font, color: INK },
    };
  }

  /** Draw every figure of the page in the colours the reader asks for. */
  function draw() {
    for (const holder of document.querySelectorAll(".figure")) {
      const figure = JSON.parse(holder.querySelector("script").textContent);
      const layout = dark.matches ? darkened(figure.layout ?? {}) : (figure.layout ?? {});
      Plotly.newPlot(holder.querySelector(".plot"), {
        data: figure.data,
        frames: figure.frames ?? [],
        layout: { ...layout, height: layout.height ?? 450 },
        config: { responsive: true, displaylogo: false },
      });
    }
  }

  dark.addEventListener("change", draw);
  draw();
})();
