//! Below the map: what is shown, what the colours tell, and the keys.

use super::view::plain;
use super::{App, Told};
use cairn_view::{By, Palette, Scene};
use eframe::egui::{self, Color32, RichText};

fn colour([r, g, b]: [f32; 3]) -> Color32 {
    let byte = |v: f32| (255.0 * v).round() as u8;
    Color32::from_rgb(byte(r), byte(g), byte(b))
}

impl App {
    /// The map in words.
    pub(super) fn words(&self, scene: &Scene) -> String {
        let (places, points) = (scene.model.key_frames.len(), scene.model.points.len());
        if places == 0 {
            return self.language.text("page-no-map");
        }
        let mut words =
            self.language.say("page-map-words", &[("places", places.into()), ("points", points.into())]);
        let area =
            scene.surface.blocks().map(|(_, block)| f64::from(block.area)).sum::<f64>().round() as usize;
        if area > 0 {
            words += " ";
            words += &self.language.say("page-map-surface", &[("area", area.into())]);
        }
        words
    }

    pub(super) fn below(&mut self, ui: &mut egui::Ui, told: &Told) {
        let (scene, language) = (&told.scene, self.language);
        let text = |id: &str| language.text(id);
        ui.add_space(6.0);
        ui.horizontal_wrapped(|ui| {
            let name = |by: By| match by {
                By::Height => text("page-map-height"),
                By::Age => text("page-map-age"),
                By::Normal => text("page-map-normal"),
            };
            let label = ui.label(text("page-map-colour"));
            let chosen = egui::ComboBox::from_id_salt("by").selected_text(name(self.choice.by));
            let chosen = chosen.show_ui(ui, |ui| {
                for by in [By::Height, By::Age, By::Normal] {
                    ui.selectable_value(&mut self.choice.by, by, name(by));
                }
            });
            chosen.response.labelled_by(label.id);
            ui.checkbox(&mut self.choice.points, text("page-map-points-show"));
            if !scene.surface.parts.is_empty() {
                ui.checkbox(&mut self.choice.surface, text("page-map-surface-show"));
            }
            if !scene.columns.tiles.is_empty() {
                ui.checkbox(&mut self.choice.columns, text("page-map-columns-show"));
            }
            if scene.walker.is_some() {
                ui.checkbox(&mut self.choice.follow, text("page-map-follow"));
            }
        });
        self.legend(ui, scene);
        ui.label(self.words(scene));
        ui.label(text("page-map-help"));
        if let Some(wrong) = &told.wrong {
            ui.label(RichText::new(wrong).color(Color32::from_rgb(0xff, 0xb3, 0xa7)));
        }
        ui.add_space(6.0);
    }

    fn legend(&self, ui: &mut egui::Ui, scene: &Scene) {
        let colours = Palette::DARK;
        let text = |id: &str| self.language.text(id);
        let ends = match self.choice.by {
            By::Height => ["page-map-low", "page-map-high"],
            By::Age => ["page-map-old", "page-map-new"],
            By::Normal => ["page-map-down", "page-map-up"],
        };
        ui.horizontal_wrapped(|ui| {
            ui.label(text(ends[0]));
            let (rect, _) = ui.allocate_exact_size(egui::vec2(96.0, 12.0), egui::Sense::hover());
            for k in 0..24_u8 {
                let left = rect.left() + 4.0 * f32::from(k);
                let part = egui::Rect::from_min_size(egui::pos2(left, rect.top()), egui::vec2(4.0, 12.0));
                ui.painter().rect_filled(part, 0.0, colour(colours.ramp((f32::from(k) + 0.5) / 24.0)));
            }
            ui.label(text(ends[1]));
            let marks = [
                (colours.way, "page-map-path", !scene.model.key_frames.is_empty()),
                (colours.route, "page-map-recorded", !scene.model.recorded.is_empty()),
                (colours.plan, "page-map-plan", !scene.model.plan.is_empty()),
                (colours.again, "page-map-loops", !scene.model.loops.is_empty()),
                (colours.eye, "page-map-eye", scene.walker.is_some()),
            ];
            for (of, id, _) in marks.into_iter().filter(|(_, _, is_there)| *is_there) {
                ui.label(RichText::new("■").color(colour(of)));
                ui.label(text(id));
            }
            let id = if scene.is_metric { "page-map-grid" } else { "page-map-grid-units" };
            let length = plain(self.square_m);
            ui.label(self.language.say(id, &[("length", length.as_str().into())]));
        });
    }
}
