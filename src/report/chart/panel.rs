use crate::report::Colour;

/// What is drawn over one piece of the x axis.
#[derive(Debug, Clone)]
pub struct Panel {
    pub(super) title: String,
    pub(super) unit: String,
    pub(super) layers: Vec<Layer>,
    pub(super) marks: Vec<Mark>,
    pub(super) lanes: Vec<Lane>,
    pub(super) log_y: bool,
    pub(super) y_range: Option<[f64; 2]>,
    pub(super) height: u32,
    pub(super) equal: bool,
}

/// One thing with an entry in the legend.
#[derive(Debug, Clone)]
pub(super) struct Layer {
    pub label: String,
    pub colour: Colour,
    pub shape: Shape,
}

#[derive(Debug, Clone)]
pub(super) enum Shape {
    Line {
        points: Vec<[f64; 2]>,
        dashed: bool,
    },
    Points {
        points: Vec<[f64; 2]>,
        names: Vec<String>,
    },
    /// x, lower end, upper end.
    Band(Vec<[f64; 3]>),
    Outline(Vec<[f64; 2]>),
}

/// Something that happened at a place of the x axis, or between two.
#[derive(Debug, Clone)]
pub(super) struct Mark {
    pub from: f64,
    pub to: f64,
    pub label: String,
    pub colour: Colour,
}

/// One row of a time line.
#[derive(Debug, Clone)]
pub(super) struct Lane {
    pub name: String,
    pub colour: Colour,
    pub spans: Vec<[f64; 2]>,
}

const HEIGHT: u32 = 150;
const LANE: u32 = 22;

impl Panel {
    /// An empty panel; the unit is that of its y axis, and left out when empty.
    pub fn new(title: impl Into<String>, unit: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            unit: unit.into(),
            layers: Vec::new(),
            marks: Vec::new(),
            lanes: Vec::new(),
            log_y: false,
            y_range: None,
            height: HEIGHT,
            equal: false,
        }
    }

    fn layer(mut self, label: impl Into<String>, colour: Colour, shape: Shape) -> Self {
        self.layers.push(Layer { label: label.into(), colour, shape });
        self
    }

    /// A line through points (x, y) in their order. An empty label has no entry in the legend.
    #[must_use]
    pub fn line(self, label: impl Into<String>, colour: Colour, points: impl IntoIterator<Item = [f64; 2]>) -> Self {
        self.layer(label, colour, Shape::Line { points: points.into_iter().collect(), dashed: false })
    }

    /// A dashed line: a limit, a reference.
    #[must_use]
    pub fn dashed(self, label: impl Into<String>, colour: Colour, points: impl IntoIterator<Item = [f64; 2]>) -> Self {
        self.layer(label, colour, Shape::Line { points: points.into_iter().collect(), dashed: true })
    }

    /// Dots at points (x, y).
    #[must_use]
    pub fn points(self, label: impl Into<String>, colour: Colour, points: impl IntoIterator<Item = [f64; 2]>) -> Self {
        self.layer(label, colour, Shape::Points { points: points.into_iter().collect(), names: Vec::new() })
    }

    /// Dots with a name beside each, as in a Pareto front.
    #[must_use]
    pub fn named_points(
        self,
        label: impl Into<String>,
        colour: Colour,
        points: impl IntoIterator<Item = ([f64; 2], String)>,
    ) -> Self {
        let (points, names) = points.into_iter().unzip();
        self.layer(label, colour, Shape::Points { points, names })
    }

    /// A shaded band: x, lower end, upper end. Behind everything else. The lines set the scale, with room for the band
    /// as far as it is of their size.
    #[must_use]
    pub fn band(self, label: impl Into<String>, colour: Colour, ends: impl IntoIterator<Item = [f64; 3]>) -> Self {
        self.layer(label, colour, Shape::Band(ends.into_iter().collect()))
    }

    /// A closed outline, lightly filled: an ellipse, a polytope.
    #[must_use]
    pub fn outline(
        self,
        label: impl Into<String>,
        colour: Colour,
        corners: impl IntoIterator<Item = [f64; 2]>,
    ) -> Self {
        self.layer(label, colour, Shape::Outline(corners.into_iter().collect()))
    }

    /// A vertical line with a label.
    #[must_use]
    pub fn event(mut self, x: f64, label: impl Into<String>) -> Self {
        self.marks.push(Mark { from: x, to: x, label: label.into(), colour: Colour::Grey });
        self
    }

    /// A shaded stretch of the x axis with a label.
    #[must_use]
    pub fn span(mut self, from: f64, to: f64, label: impl Into<String>, colour: Colour) -> Self {
        self.marks.push(Mark { from, to, label: label.into(), colour });
        self
    }

    /// A row of a time line with the stretches in which something held. A panel with lanes has no y axis: what else is
    /// in it, but for marks, is not drawn.
    #[must_use]
    pub fn lane(mut self, name: impl Into<String>, colour: Colour, spans: impl IntoIterator<Item = [f64; 2]>) -> Self {
        self.lanes.push(Lane { name: name.into(), colour, spans: spans.into_iter().collect() });
        self.height = LANE * self.lanes.len() as u32;
        self
    }

    /// A logarithmic y axis, on which only positive numbers have a place.
    #[must_use]
    pub fn log_y(mut self) -> Self {
        self.log_y = true;
        self
    }

    /// Ends of the y axis; those of the data when left out.
    #[must_use]
    pub fn range_y(mut self, from: f64, to: f64) -> Self {
        self.y_range = Some([from, to]);
        self
    }

    /// Height of the plotted area in pixels, 150 when left out.
    #[must_use]
    pub fn height(mut self, pixels: u32) -> Self {
        self.height = pixels.clamp(20, 4000);
        self
    }

    /// The same scale on both axes, so that a circle looks like one. Holds in a figure of one panel.
    #[must_use]
    pub fn equal(mut self) -> Self {
        self.equal = true;
        self
    }

    /// Every x that has a place in the panel.
    pub(super) fn xs(&self) -> impl Iterator<Item = f64> + '_ {
        let marks = self.marks.iter().flat_map(|m| [m.from, m.to]);
        let lanes = self.lanes.iter().flat_map(|l| l.spans.iter().flatten().copied());
        let layers = self.layers.iter().flat_map(|l| -> Box<dyn Iterator<Item = f64> + '_> {
            match &l.shape {
                Shape::Line { points, .. } | Shape::Points { points, .. } | Shape::Outline(points) => {
                    Box::new(points.iter().map(|p| p[0]))
                }
                Shape::Band(ends) => Box::new(ends.iter().map(|e| e[0])),
            }
        });
        layers.chain(marks).chain(lanes)
    }

    /// Every y of lines, dots and outlines.
    pub(super) fn ys(&self) -> impl Iterator<Item = f64> + '_ {
        self.layers.iter().flat_map(|l| match &l.shape {
            Shape::Line { points, .. } | Shape::Points { points, .. } | Shape::Outline(points) => {
                points.iter().map(|p| p[1]).collect()
            }
            Shape::Band(_) => Vec::new(),
        })
    }

    /// Every end of the bands.
    pub(super) fn ends(&self) -> impl Iterator<Item = f64> + '_ {
        self.layers.iter().flat_map(|l| match &l.shape {
            Shape::Band(ends) => ends.iter().flat_map(|e| [e[1], e[2]]).collect(),
            _ => Vec::new(),
        })
    }
}
