//! The map in the window: keys and mouse in, a picture out.

use super::canvas::{Canvas, Frame};
use super::{App, Picture};
use cairn_view::{Marks, Palette, Scene, ground, key_of, marks, round_length, shading};
use eframe::egui::{self, Event, Key, Modifiers};
use eframe::egui_glow;
use std::sync::{Arc, PoisonError};

/// Angle for each pixel that it is dragged by, radians; growth for each that the wheel is turned by.
const TURN: f32 = 0.01;
const GROW: f32 = 0.0025;
/// The longest scale bar, pixels.
const BAR: f32 = 110.0;

/// The name of a key as browsers have it.
fn name_of(key: Key) -> &'static str {
    match key {
        Key::ArrowLeft => "ArrowLeft",
        Key::ArrowRight => "ArrowRight",
        Key::ArrowUp => "ArrowUp",
        Key::ArrowDown => "ArrowDown",
        Key::Plus => "+",
        Key::Equals => "=",
        Key::Minus => "-",
        other => other.name(),
    }
}

impl App {
    /// The map.
    pub(super) fn map(&mut self, ui: &mut egui::Ui, scene: &Scene) {
        let (rect, response) = ui.allocate_exact_size(ui.available_size(), egui::Sense::click_and_drag());
        let [title, words] = [self.language.text("page-map-title"), self.words(scene)];
        response.widget_info(|| {
            egui::WidgetInfo::labeled(egui::WidgetType::Image, true, format!("{title}. {words}"))
        });
        if response.clicked() || ui.memory(|m| m.focused().is_none()) {
            response.request_focus();
        }
        let arrows = egui::EventFilter {
            horizontal_arrows: true,
            vertical_arrows: true,
            ..egui::EventFilter::default()
        };
        ui.memory_mut(|m| m.set_focus_lock_filter(response.id, arrows));
        self.moved(ui, &response);
        let picture = self.picture_of(ui, rect, scene);
        let bar = self.bar(&picture.frame, rect.height());
        let (told, canvas) = (self.told.clone(), self.canvas.clone());
        let draw = move |_: egui::PaintCallbackInfo, painter: &egui_glow::Painter| {
            let told = told.lock().unwrap_or_else(PoisonError::into_inner);
            let mut canvas: std::sync::MutexGuard<Canvas> =
                canvas.lock().unwrap_or_else(PoisonError::into_inner);
            let of = [picture.marks.as_ref(), Some(&picture.own)];
            if let Err(why) = canvas.draw(painter.gl(), &told.scene, of, &picture.frame) {
                eprintln!("warning: the graphics card: {why}");
            }
        };
        let callback = Arc::new(egui_glow::CallbackFn::new(draw));
        ui.painter().add(egui::PaintCallback { rect, callback });
        let at = rect.left_bottom() + egui::vec2(16.0, -16.0);
        let end = at + egui::vec2(bar.0, 0.0);
        let colour = egui::Color32::from_rgb(0xc3, 0xcc, 0xd6);
        ui.painter().line_segment([at, end], egui::Stroke::new(2.0, colour));
        let above = at + egui::vec2(0.0, -4.0);
        let font = egui::FontId::proportional(14.0);
        let id = if scene.is_metric { "page-map-bar" } else { "page-map-bar-units" };
        let text = self.language.say(id, &[("length", bar.1.as_str().into())]);
        ui.painter().text(above, egui::Align2::LEFT_BOTTOM, text, font, colour);
    }

    /// Keys, mouse and wheel.
    fn moved(&mut self, ui: &egui::Ui, response: &egui::Response) {
        let by = response.drag_delta();
        let height = response.rect.height().max(1.0);
        let moves = ui.input(|i| i.modifiers.shift) || response.dragged_by(egui::PointerButton::Secondary);
        match moves {
            true => self.orbit.shift(-by.x / height, by.y / height),
            false => self.orbit.turn(TURN * by.x, TURN * by.y),
        }
        if response.hovered() {
            let (wheel, pinch) = ui.input(|i| (i.smooth_scroll_delta.y, i.zoom_delta()));
            self.orbit.grow((GROW * wheel).exp() * pinch);
        }
        if !response.has_focus() {
            return;
        }
        let pressed: Vec<(Key, Modifiers)> = ui.input(|i| {
            let key = |e: &Event| match e {
                Event::Key { key, pressed: true, modifiers, .. } => Some((*key, *modifiers)),
                _ => None,
            };
            i.events.iter().filter_map(key).collect()
        });
        for (key, held) in pressed.into_iter().filter(|(_, held)| !held.ctrl && !held.alt && !held.command) {
            if let Some(key) = key_of(name_of(key)) {
                self.orbit.act(key.act, held.shift);
            }
        }
    }

    /// What is drawn now.
    fn picture_of(&mut self, ui: &egui::Ui, rect: egui::Rect, scene: &Scene) -> Picture {
        let (colours, choice) = (Palette::DARK, self.choice);
        let shading = shading(scene, choice);
        let around = scene.walker.filter(|_| choice.follow).map_or(shading.middle, |walker| walker[0]);
        let aspect = rect.width() / rect.height().max(1.0);
        let up = scene.model.up;
        let look = self.orbit.look(around, shading.size, up, aspect.max(1e-3));
        let is_new = self.drawn != Some((scene.version, choice));
        self.drawn = Some((scene.version, choice));
        let mut own = Marks::default();
        self.square_m = own.add_grid(up, &shading, self.orbit.zoom, look.middle, colours.faint);
        if let Some(walker) = scene.walker {
            own.add_walker(walker, &look, rect.height(), colours.eye);
        }
        let scale = ui.ctx().pixels_per_point();
        let frame = Frame {
            look,
            pixels: [rect.width() * scale, rect.height() * scale],
            scale,
            up: ground(up)[2],
            by: choice.by,
            shading,
            surface: choice.surface,
            columns: choice.columns,
        };
        Picture { marks: is_new.then(|| marks(scene, choice, &shading, &colours)), own, frame }
    }

    /// Length of a round bar on the screen, and what it is in the map.
    fn bar(&self, frame: &Frame, height: f32) -> (f32, String) {
        let pixels = frame.look.pixels(height);
        let mut length = round_length(BAR / pixels);
        while length * pixels > BAR {
            length = round_length(length / 2.5);
        }
        (length * pixels, plain(length))
    }
}

/// A round length as people write it.
pub(super) fn plain(length: f32) -> String {
    format!("{length:.*}", (-length.max(1e-6).log10().floor()).max(0.0) as usize)
}
