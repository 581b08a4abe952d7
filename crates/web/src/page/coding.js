// What becomes of an image of the camera: a JPEG for the way to a server, or gray bytes for an engine in this device.

export const jpeg = {
  readsBack: false,
  // Milliseconds (64-bit float), then the JPEG; null where the browser makes none.
  code: (canvas, ms, quality) => new Promise((done) => {
    canvas.toBlob(async (blob) => {
      if (!blob) return done(null);
      const bytes = new Uint8Array(8 + blob.size);
      new DataView(bytes.buffer).setFloat64(0, ms, true);
      bytes.set(new Uint8Array(await blob.arrayBuffer()), 8);
      return done(bytes);
    }, 'image/jpeg', quality);
  }),
};

// Before the gray bytes: milliseconds (64-bit float), width and height (32 bits each).
export const GRAY_HEAD = 16;

export const gray = {
  readsBack: true,
  code: async (canvas, ms) => {
    const { width, height } = canvas;
    const colours = canvas.getContext('2d').getImageData(0, 0, width, height).data;
    const bytes = new Uint8Array(GRAY_HEAD + width * height);
    const head = new DataView(bytes.buffer);
    head.setFloat64(0, ms, true);
    head.setUint32(8, width, true);
    head.setUint32(12, height, true);
    // The luminance of JPEG (BT.601), in 1/256.
    for (let from = 0, to = GRAY_HEAD; to < bytes.length; from += 4, to += 1) {
      bytes[to] = (77 * colours[from] + 150 * colours[from + 1] + 29 * colours[from + 2] + 128) >> 8;
    }
    return bytes;
  },
};
