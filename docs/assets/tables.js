// Wide tables scroll in a box of their own, which the keyboard must reach as well as the mouse does.
document$.subscribe(() =>
  requestAnimationFrame(() => {
    for (const box of document.querySelectorAll(".md-typeset__scrollwrap"))
      if (box.scrollWidth > box.clientWidth) box.tabIndex = 0
  })
)
