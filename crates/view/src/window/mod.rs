//! The window: the map, and below it what is shown, what the colours tell, and the keys.

mod canvas;
mod gl;
mod panel;
mod view;

use cairn_phrases::Language;
use cairn_view::{Choice, Marks, Orbit, Scene, read_message};
use canvas::Canvas;
use eframe::egui;
use std::cell::RefCell;
use std::io::stdin;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::{Arc, Mutex, PoisonError};

/// Its size at the beginning, and the samples of a pixel.
const SIZE: [f32; 2] = [1100.0, 800.0];
const SAMPLES: u16 = 4;
/// Pictures that are drawn until the window has its size, before one is written.
const SETTLED: u32 = 4;

/// Why there is no window, or no picture of it.
#[derive(Debug, thiserror::Error)]
pub enum WindowError {
    /// The system gives no window.
    #[error(transparent)]
    System(#[from] eframe::Error),
    /// The picture could not be written.
    #[error("{}: {source}", path.display())]
    Picture {
        /// Its file.
        path: PathBuf,
        /// What went wrong.
        source: png::EncodingError,
    },
}

/// What the pipe tells.
#[derive(Default)]
struct Told {
    scene: Scene,
    /// Nothing more comes: whoever shows something here has gone, or a picture is wanted.
    is_all: bool,
    /// Why no more is shown, if something is wrong.
    wrong: Option<String>,
}

/// Opens the window and shows what comes, until it is closed.
///
/// # Errors
/// When the system gives no window, or the picture cannot be written.
pub fn show(language: Language, picture: Option<PathBuf>) -> Result<(), WindowError> {
    let viewport = egui::ViewportBuilder::default().with_inner_size(SIZE).with_app_id("cairn-view");
    let options = eframe::NativeOptions {
        viewport,
        depth_buffer: 24,
        multisampling: SAMPLES,
        renderer: eframe::Renderer::Glow,
        ..eframe::NativeOptions::default()
    };
    let failed = Rc::new(RefCell::new(None));
    let app_failed = failed.clone();
    let begin = move |cc: &eframe::CreationContext| -> Result<Box<dyn eframe::App>, _> {
        let gl = cc.gl.as_ref().ok_or("the system gives no OpenGL")?;
        let told = Arc::new(Mutex::new(Told::default()));
        let (to, ctx) = (told.clone(), cc.egui_ctx.clone());
        std::thread::Builder::new().name("cairn-view".into()).spawn(move || follow(&to, &ctx))?;
        let canvas = Arc::new(Mutex::new(Canvas::new(gl)?));
        let app = App {
            language,
            told,
            canvas,
            orbit: Orbit::default(),
            choice: Choice::default(),
            drawn: None,
            title: String::new(),
            square_m: 1.0,
            picture,
            settled: 0,
            failed: app_failed,
        };
        Ok(Box::new(app))
    };
    eframe::run_native("Cairn", options, Box::new(begin))?;
    let why = failed.take();
    why.map_or(Ok(()), Err)
}

/// Takes the messages of the pipe as they come.
fn follow(told: &Mutex<Told>, ctx: &egui::Context) {
    let mut from = stdin().lock();
    loop {
        let message = read_message(&mut from);
        let mut told = told.lock().unwrap_or_else(PoisonError::into_inner);
        let taken = match message {
            Ok(Some(message)) => told.scene.take(&message).map_err(|e| e.to_string()),
            Ok(None) => {
                told.is_all = true;
                Ok(())
            }
            Err(e) => Err(e.to_string()),
        };
        if let Err(why) = taken {
            (told.wrong, told.is_all) = (Some(why), true);
        }
        let is_all = told.is_all;
        drop(told);
        ctx.request_repaint();
        if is_all {
            return;
        }
    }
}

struct App {
    language: Language,
    told: Arc<Mutex<Told>>,
    canvas: Arc<Mutex<Canvas>>,
    orbit: Orbit,
    choice: Choice,
    /// The marks that were drawn last, of which version of the scene they are and of which choice.
    drawn: Option<(u64, Choice)>,
    title: String,
    /// Edge of a square of the grid.
    square_m: f32,
    picture: Option<PathBuf>,
    settled: u32,
    /// Why the picture was not written.
    failed: Rc<RefCell<Option<WindowError>>>,
}

/// What is drawn in the window now.
struct Picture {
    /// Marks of the scene, where they are others than before, and of this picture.
    marks: Option<Marks>,
    own: Marks,
    frame: canvas::Frame,
}

impl eframe::App for App {
    fn update(&mut self, ctx: &egui::Context, _: &mut eframe::Frame) {
        let told = self.told.clone();
        let told = told.lock().unwrap_or_else(PoisonError::into_inner);
        if told.scene.title != self.title {
            self.title.clone_from(&told.scene.title);
            ctx.send_viewport_cmd(egui::ViewportCommand::Title(format!("{} - Cairn", self.title)));
        }
        ctx.set_visuals(egui::Visuals::dark());
        egui::TopBottomPanel::bottom("below").show(ctx, |ui| self.below(ui, &told));
        egui::CentralPanel::default().frame(egui::Frame::NONE).show(ctx, |ui| self.map(ui, &told.scene));
        let (is_all, is_wrong) = (told.is_all, told.wrong.is_some());
        drop(told);
        match self.picture.clone() {
            Some(path) if is_all => self.write(ctx, &path),
            None if is_all && !is_wrong => ctx.send_viewport_cmd(egui::ViewportCommand::Close),
            _ => {}
        }
    }

    fn on_exit(&mut self, gl: Option<&eframe::glow::Context>) {
        if let Some(gl) = gl {
            self.canvas.lock().unwrap_or_else(PoisonError::into_inner).delete(gl);
        }
    }
}

impl App {
    /// Asks for a picture of the window once it has settled, writes it when it has come, and ends.
    fn write(&mut self, ctx: &egui::Context, path: &Path) {
        let shot = ctx.input(|i| {
            i.events.iter().find_map(|e| match e {
                egui::Event::Screenshot { image, .. } => Some(image.clone()),
                _ => None,
            })
        });
        if let Some(image) = shot {
            if let Err(source) = write_png(path, &image) {
                let why = WindowError::Picture { path: path.to_owned(), source };
                *self.failed.borrow_mut() = Some(why);
            }
            self.picture = None;
            ctx.send_viewport_cmd(egui::ViewportCommand::Close);
            return;
        }
        self.settled += 1;
        if self.settled == SETTLED {
            ctx.send_viewport_cmd(egui::ViewportCommand::Screenshot(egui::UserData::default()));
        }
        ctx.request_repaint();
    }
}

fn write_png(path: &Path, image: &egui::ColorImage) -> Result<(), png::EncodingError> {
    let file = std::fs::File::create(path)?;
    let [width, height] = image.size.map(|n| n as u32);
    let mut encoder = png::Encoder::new(std::io::BufWriter::new(file), width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let pixels: Vec<u8> = image.pixels.iter().flat_map(|p| [p.r(), p.g(), p.b()]).collect();
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&pixels)?;
    writer.finish()
}
