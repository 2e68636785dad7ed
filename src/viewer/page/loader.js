// Unpacks the libraries that the page holds, then starts the page's own program.
(async () => {
  const text = (id) => document.getElementById(id).textContent;
  const packed = Uint8Array.from(atob(text("file:libraries.js.gz").trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  for (const code of [await new Response(stream).text(), text("program")]) {
    const script = document.createElement("script");
    script.textContent = code;
    document.body.append(script);
  }
})().catch((error) => {
  document.getElementById("state").textContent = `The page could not be started: ${error.message}`;
});
