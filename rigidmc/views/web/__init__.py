"""What the pages share in the browser: `page.html` and `page.css`, `common.js` (elements, speeds,
themes), `stage.js` (solids and curves on a canvas), `drawings.js` (the body in space, the momentum
sphere) and `charts.js`. `rigidmc.views.html_page` puts them together."""
