// The files that an engine in this device keeps: given out as one archive, and taken in again.

const $ = (id) => document.getElementById(id);
const NAME = 'cairn-routes.tar';

export class Files {
  // `give` asks for the archive, `put` takes files; `tell` shows and speaks whether something was done.
  constructor({ give, put, tell, t, hasRoutes }) {
    Object.assign(this, { tell, t });
    $('files-export').addEventListener('click', give);
    $('files-import').addEventListener('click', () => {
      if (hasRoutes()) $('replace').showModal();
      else $('files-given').click();
    });
    $('replace-no').addEventListener('click', () => $('replace').close());
    $('replace-yes').addEventListener('click', () => {
      $('replace').close();
      $('files-given').click();
    });
    $('files-given').addEventListener('change', async () => {
      const given = await Promise.all([...$('files-given').files].map(async (file) => ({
        name: file.name, bytes: new Uint8Array(await file.arrayBuffer()),
      })));
      $('files-given').value = '';
      put(given);
    });
  }

  // The archive has come: the browser saves it where it saves downloads.
  save(bytes) {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(new Blob([bytes], { type: 'application/x-tar' }));
    link.download = NAME;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
    this.tell(true, this.t('page-exported', { file: NAME }));
  }

  // What came of files that were given.
  took({ count, wrong }) {
    this.tell(!wrong, wrong ? this.t('page-import-wrong', { file: wrong }) : this.t('page-imported', { count }));
  }
}
