//! The scenarios that come with the program, as the very files a user can copy and edit.

macro_rules! bundled {
    ($name:literal) => {
        ($name, include_str!(concat!("../../../config/scenarios/", $name, ".toml")))
    };
}

const BUNDLED: [(&str, &str); 18] = [
    bundled!("demo"),
    bundled!("hover"),
    bundled!("wind-steps"),
    bundled!("gusts"),
    bundled!("turbulence"),
    bundled!("paper-disturbance"),
    bundled!("payload"),
    bundled!("rotor-faults"),
    bundled!("sensor-faults"),
    bundled!("bad-link"),
    bundled!("rough-sensors"),
    bundled!("px4-wind"),
    bundled!("hexa"),
    bundled!("healthy"),
    bundled!("faults-quad-50"),
    bundled!("faults-quad-200"),
    bundled!("faults-hexa-50"),
    bundled!("faults-hexa-200"),
];

/// The names that [`super::resolve`] knows.
pub fn names() -> impl Iterator<Item = &'static str> {
    BUNDLED.iter().map(|(name, _)| *name)
}

pub(super) fn text(name: &str) -> Option<&'static str> {
    BUNDLED.iter().find(|(n, _)| *n == name).map(|(_, text)| *text)
}
