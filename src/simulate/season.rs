//! Colours of the seasons: smooth, periodic functions of the day of the year.

use super::field::Material;
use super::keyed_rng::KeyedRng;
use super::surface::Surface;
use super::texture::Albedo;

/// Key days of winter, spring, summer and autumn: days of the year on which the colours of [`GRASS`] and [`TREES`] hold.
const KEY_DAYS: [f64; 4] = [52.0, 115.0, 196.0, 288.0];
/// Mean reflectance of grass on the key days. The hue rises from winter to summer and falls from summer to winter.
const GRASS: [[f64; 3]; 4] =
    [[0.27, 0.225, 0.165], [0.21, 0.34, 0.10], [0.11, 0.21, 0.075], [0.44, 0.33, 0.12]];
/// Mean reflectance of tree crowns on the key days.
const TREES: [[f64; 3]; 4] =
    [[0.17, 0.14, 0.115], [0.15, 0.27, 0.07], [0.065, 0.145, 0.05], [0.36, 0.20, 0.055]];
/// Mean colour of the grass of the texture.
const GRASS_TEXTURE: [f64; 3] = [0.29, 0.31, 0.18];
/// Mean colour of the tree crowns of the texture.
const TREES_TEXTURE: [f64; 3] = [0.145, 0.188, 0.083];
/// Reflectance of snow: neutral, so that a thin cover leaves the hue of the ground.
const SNOW: f64 = 0.78;
/// Largest fraction of the ground's colour that is snow.
const DEEPEST_SNOW: f64 = 0.75;
/// Number of days before and after the key day of winter with snow.
const SNOW_DAYS: f64 = 42.0;
/// Distance over which the cover of snow varies, metres.
const SNOW_PATCH_M: f64 = 22.0;
const YEAR_DAYS: f64 = 365.0;

/// The colours of a day.
#[derive(Clone, Debug)]
pub(super) struct Palette {
    grass: Tint,
    trees: Tint,
    /// Fraction of the colour that is snow where most of it lies.
    pub(super) snow: f64,
    /// Address of the random numbers that place the snow.
    patches: KeyedRng,
}

/// How a season changes the colours of vegetation.
#[derive(Clone, Copy, Debug)]
enum Tint {
    /// Factors of the texture's colours, by band.
    Factors([f64; 3]),
    /// Reflectance per unit of the texture's brightness, by band: the hue is that of the season everywhere.
    OfBrightness([f64; 3]),
}

impl Tint {
    fn apply(self, texture: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Factors(factors) => std::array::from_fn(|b| texture[b] * factors[b]),
            Self::OfBrightness(color) => color.map(|c| c * brightness(texture)),
        }
    }
}

impl Palette {
    /// Vegetation that dries a little from spring to autumn; `town` is the address of the town's colours.
    pub(super) fn mild(day_of_year: u32, town: KeyedRng) -> Self {
        let summer = ((f64::from(day_of_year) - 120.0) / 120.0).clamp(0.0, 1.0);
        let tint = Tint::Factors([0.9 + 0.4 * summer, 1.08 - 0.06 * summer, 0.95]);
        Self { grass: tint, trees: tint, snow: 0.0, patches: town.key(60) }
    }

    /// Spring green, the dark green of summer, yellow-brown autumn, grey-brown winter with thin snow.
    pub(super) fn seasonal(day_of_year: u32, town: KeyedRng) -> Self {
        let day = f64::from(day_of_year);
        let tint = |colors, texture_mean| {
            Tint::OfBrightness(between_key_days(day, colors).map(|c| c / brightness(texture_mean)))
        };
        Self {
            grass: tint(GRASS, GRASS_TEXTURE),
            trees: tint(TREES, TREES_TEXTURE),
            snow: DEEPEST_SNOW * snow_of_day(day),
            patches: town.key(60),
        }
    }

    /// Mean reflectance of grass and of tree crowns, by band.
    pub(super) fn means(&self) -> [[f64; 3]; 2] {
        [self.grass.apply(GRASS_TEXTURE), self.trees.apply(TREES_TEXTURE)]
    }

    /// Reflectance on this day, by band, of a surface that the texture gives the colour `albedo`.
    pub(super) fn reflectance(&self, surface: &Surface, albedo: Albedo) -> [f64; 3] {
        let texture = albedo.map(f64::from);
        let bare = match surface.material {
            Material::Grass => self.grass.apply(texture),
            Material::Tree => self.trees.apply(texture),
            _ => texture,
        };
        // Streets are cleared of snow.
        let keeps_snow = matches!(
            surface.material,
            Material::Grass | Material::Paving | Material::Roof | Material::Rock | Material::Scree
        );
        if self.snow == 0.0 || surface.is_wall || !keeps_snow {
            return bare;
        }
        let cover = self.snow * self.snow_at(surface.place[0], surface.place[1]);
        bare.map(|c| c + (SNOW - c) * cover)
    }

    /// How much of the day's snow lies at a position, 0 to 1; about half of the ground has some.
    fn snow_at(&self, x: f64, y: f64) -> f64 {
        smoothstep(0.5 + 2.5 * self.patches.fractal_noise(x, y, SNOW_PATCH_M, 3))
    }
}

/// The colour of a day between two key days; it lies on the straight line between their colours, so that the hue changes in
/// one direction only, and it has no kink at the key days.
fn between_key_days(day: f64, colors: [[f64; 3]; 4]) -> [f64; 3] {
    let from = KEY_DAYS.iter().rposition(|key| *key <= day).unwrap_or(3);
    let to = (from + 1) % 4;
    let length = (KEY_DAYS[to] - KEY_DAYS[from]).rem_euclid(YEAR_DAYS);
    let t = smoothstep((day - KEY_DAYS[from]).rem_euclid(YEAR_DAYS) / length);
    std::array::from_fn(|b| colors[from][b] + (colors[to][b] - colors[from][b]) * t)
}

/// Amount of snow on a day: 1 on the key day of winter, 0 from [`SNOW_DAYS`] on.
fn snow_of_day(day: f64) -> f64 {
    let apart = (day - KEY_DAYS[0]).rem_euclid(YEAR_DAYS);
    smoothstep(1.0 - apart.min(YEAR_DAYS - apart) / SNOW_DAYS)
}

fn brightness(color: [f64; 3]) -> f64 {
    color.iter().sum::<f64>() / 3.0
}

/// A smooth step from 0 at 0 to 1 at 1.
pub(super) fn smoothstep(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Hue of the HSV model, degrees.
    fn hue_deg([r, g, b]: [f64; 3]) -> f64 {
        let (low, high) = (r.min(g).min(b), r.max(g).max(b));
        let sextant = match high {
            h if h == g => 2.0 + (b - r) / (high - low),
            h if h == r => (g - b) / (high - low),
            _ => 4.0 + (r - g) / (high - low),
        };
        60.0 * sextant
    }

    fn surface(material: Material) -> Surface {
        Surface {
            place: [3.0, 4.0, 150.0],
            material,
            albedo: [0.2, 0.3, 0.15],
            normal: [0.0, 0.0, 1.0],
            is_wall: false,
        }
    }

    /// Hues from a key day to another one, every day, through the turn of the year if need be.
    fn hues(material: Material, from: f64, to: f64) -> Vec<f64> {
        let (surface, town) = (surface(material), KeyedRng::new(5));
        let days = (to - from).rem_euclid(YEAR_DAYS) as u32;
        let day = |i: u32| (from as u32 + i - 1) % YEAR_DAYS as u32 + 1;
        let on = |day: u32| Palette::seasonal(day, town).reflectance(&surface, surface.albedo);
        (0..=days).map(|i| hue_deg(on(day(i)))).collect()
    }

    #[test]
    fn the_hue_of_vegetation_rises_from_winter_to_summer_and_falls_to_winter_without_jumps() {
        let [winter, _, summer, autumn] = KEY_DAYS;
        for material in [Material::Grass, Material::Tree] {
            let rising = hues(material, winter, summer);
            assert!(
                rising.windows(2).all(|w| w[1] > w[0] - 1e-9 && w[1] - w[0] < 3.0),
                "{material:?} {rising:?}"
            );
            let falling = hues(material, summer, winter);
            assert!(
                falling.windows(2).all(|w| w[1] < w[0] + 1e-9 && w[0] - w[1] < 3.0),
                "{material:?} {falling:?}"
            );
            assert!(rising.last().unwrap() - rising[0] > 50.0, "{rising:?}");
            assert!(hues(material, summer, autumn).last().unwrap() - rising.last().unwrap() < -40.0);
        }
    }

    #[test]
    fn snow_lies_in_winter_on_a_part_of_roofs_and_grass_but_not_on_streets() {
        let winter = Palette::seasonal(KEY_DAYS[0] as u32, KeyedRng::new(5));
        let covered = |material: Material| {
            let white = |i: u32| {
                let mut surface = surface(material);
                surface.place = [f64::from(i % 50) * 7.0, f64::from(i / 50) * 7.0, 150.0];
                let bare = Palette { snow: 0.0, ..winter.clone() }.reflectance(&surface, surface.albedo);
                winter.reflectance(&surface, surface.albedo)[1] > bare[1] + 0.1
            };
            f64::from((0..2500).filter(|i| white(*i)).count() as u32) / 2500.0
        };
        for material in [Material::Roof, Material::Grass] {
            assert!((0.3..0.7).contains(&covered(material)), "{material:?} {}", covered(material));
        }
        assert_eq!(covered(Material::Asphalt), 0.0);
        let summer = Palette::seasonal(KEY_DAYS[2] as u32, KeyedRng::new(5));
        assert_eq!(summer.snow, 0.0);
    }
}
