//! Whisker of a mapping: a preset, values over it, or all parameters.

use std::path::Path;

use files::Error;
use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;
use whisker::{Curvature, Whisker};

/// Whisker as stated.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub(super) enum StatedWhisker {
    /// Name of a preset.
    Preset(String),
    /// A preset and the values that differ from it, or all parameters.
    Parameters(Box<Parameters>),
}

/// Parameters of a whisker, as far as they are stated.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Parameters {
    #[serde(default, deserialize_with = "stated", skip_serializing_if = "Option::is_none")]
    preset: Option<Value>,
    #[serde(default, deserialize_with = "stated", skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    #[serde(default, deserialize_with = "stated", skip_serializing_if = "Option::is_none")]
    length_m: Option<f64>,
    #[serde(default, deserialize_with = "stated", skip_serializing_if = "Option::is_none")]
    root_diameter_m: Option<f64>,
    #[serde(default, deserialize_with = "stated", skip_serializing_if = "Option::is_none")]
    tip_diameter_m: Option<f64>,
    #[serde(default, deserialize_with = "stated", skip_serializing_if = "Option::is_none")]
    youngs_modulus_pa: Option<f64>,
    #[serde(default, deserialize_with = "stated", skip_serializing_if = "Option::is_none")]
    density_kg_m3: Option<f64>,
    #[serde(default, deserialize_with = "stated", skip_serializing_if = "Option::is_none")]
    curvature: Option<Vec<Curvature>>,
    #[serde(default, deserialize_with = "stated", skip_serializing_if = "Option::is_none")]
    root_stiffness_n_m_rad: Option<f64>,
    #[serde(default, deserialize_with = "stated", skip_serializing_if = "Option::is_none")]
    segments: Option<u32>,
    #[serde(default, deserialize_with = "stated", skip_serializing_if = "Option::is_none")]
    damping_s: Option<f64>,
}

/// A value that may be absent, but not null.
fn stated<'de, T: Deserialize<'de>, D: Deserializer<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    T::deserialize(deserializer).map(Some)
}

impl<'de> Deserialize<'de> for StatedWhisker {
    /// Not as an untagged enumeration, whose errors have no place in the file.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Form;
        impl<'de> Visitor<'de> for Form {
            type Value = StatedWhisker;

            fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                formatter.write_str("a `whisker`: the name of a preset, or an object")
            }

            fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<Self::Value, E> {
                Ok(StatedWhisker::Preset(name.into()))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                let parameters = Parameters::deserialize(MapAccessDeserializer::new(map))?;
                Ok(StatedWhisker::Parameters(Box::new(parameters)))
            }
        }
        deserializer.deserialize_any(Form)
    }
}

impl StatedWhisker {
    /// The whisker.
    ///
    /// # Errors
    /// [`Error::Value`] if a parameter is missing, or if another whisker has the name of a preset.
    pub(super) fn whisker(&self, path: &Path) -> Result<Whisker, Error> {
        let stated = match self {
            Self::Preset(name) => return preset(path, "whisker", name),
            Self::Parameters(stated) => stated,
        };
        let base = match &stated.preset {
            None => None,
            Some(Value::String(name)) => Some(preset(path, "whisker.preset", name)?),
            Some(found) => return Err(Error::value(path, "whisker.preset", found, "the name of a preset")),
        };
        let whisker = stated.over(path, base.as_ref())?;
        if presets().iter().any(|preset| preset.name == whisker.name && *preset != whisker) {
            let found = stated.name.as_ref().map_or_else(|| "none".into(), |name| format!("`{name}`"));
            let expected = "a name that is not that of a preset, since the parameters differ from it";
            return Err(Error::value(path, "whisker.name", found, expected));
        }
        Ok(whisker)
    }
}

impl Parameters {
    /// These parameters, the others those of a preset.
    fn over(&self, path: &Path, base: Option<&Whisker>) -> Result<Whisker, Error> {
        fn value<T: Clone>(
            path: &Path,
            key: &str,
            stated: &Option<T>,
            base: Option<&Whisker>,
            of: fn(&Whisker) -> &T,
        ) -> Result<T, Error> {
            let missing =
                || Error::value(path, format!("whisker.{key}"), "none", "a value, or a `preset` that has one");
            stated.as_ref().or(base.map(of)).cloned().ok_or_else(missing)
        }
        let number = |key: &str, stated: &Option<f64>, of: fn(&Whisker) -> &f64| value(path, key, stated, base, of);
        Ok(Whisker {
            name: value(path, "name", &self.name, base, |of| &of.name)?,
            length_m: number("length_m", &self.length_m, |of| &of.length_m)?,
            root_diameter_m: number("root_diameter_m", &self.root_diameter_m, |of| &of.root_diameter_m)?,
            tip_diameter_m: number("tip_diameter_m", &self.tip_diameter_m, |of| &of.tip_diameter_m)?,
            youngs_modulus_pa: number("youngs_modulus_pa", &self.youngs_modulus_pa, |of| &of.youngs_modulus_pa)?,
            density_kg_m3: number("density_kg_m3", &self.density_kg_m3, |of| &of.density_kg_m3)?,
            curvature: value(path, "curvature", &self.curvature, base, |of| &of.curvature)?,
            root_stiffness_n_m_rad: number("root_stiffness_n_m_rad", &self.root_stiffness_n_m_rad, |of| {
                &of.root_stiffness_n_m_rad
            })?,
            segments: value(path, "segments", &self.segments, base, |of| &of.segments)?,
            damping_s: number("damping_s", &self.damping_s, |of| &of.damping_s)?,
        })
    }
}

fn presets() -> [Whisker; 3] {
    [Whisker::straight(), Whisker::curved(), Whisker::stanford()]
}

fn preset(path: &Path, key: &str, name: &str) -> Result<Whisker, Error> {
    let found = presets().into_iter().find(|preset| preset.name == name);
    found.ok_or_else(|| {
        let known = presets().map(|preset| preset.name).join(", ");
        Error::value(path, key, format!("`{name}`"), format!("one of: {known}"))
    })
}
