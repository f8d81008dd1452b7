(async () => {
  "use strict";

  const { kind, width, figures } = JSON.parse(document.getElementById("figures").textContent);
  const ink = "#1f2328";
  const paper = "#ffffff";

  /** Leave a text in the page for whoever reads its DOM. */
  function leave(text, attributes) {
    const holder = Object.assign(document.createElement("pre"), attributes);
    holder.textContent = text;
    document.body.append(holder);
  }

  try {
    const pictures = [];
    for (const { data, layout } of figures) {
      const height = layout.height ?? 450;
      const printed = {
        ...layout,
        width,
        height,
        font: { ...layout.font, color: ink },
        paper_bgcolor: paper,
        plot_bgcolor: paper,
      };
      const plot = await Plotly.newPlot(document.createElement("div"), { data, layout: printed });
      const scale = kind === "png" ? 2 : 1;
      pictures.push(await Plotly.toImage(plot, { format: kind, width, height, scale }));
      Plotly.purge(plot);
    }
    for (const picture of pictures) leave(picture, { className: "picture" });
  } catch (error) {
    leave(String(error), { id: "failure" });
  }
})();
