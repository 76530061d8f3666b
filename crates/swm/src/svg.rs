//! Just enough SVG for the figures of reports: one file each, without scripts, in colors for light and dark pages.

use std::fmt::Write as _;

/// Widths and sizes are in the units of the view box; text is 12 of them high.
pub(crate) struct Svg {
    width: f64,
    height: f64,
    title: String,
    body: String,
}

/// Colors by role; `prefers-color-scheme` chooses.
const STYLE: &str = "\
.fig{font:12px system-ui,sans-serif}\
.fig .bg{fill:#fff}.fig text{fill:#1f2430}.fig .soft{fill:#5b6475}.fig .strong{font-weight:600}\
.fig .grid{stroke:#e3e6ec}.fig .axis{stroke:#8a93a5}.fig .bound{stroke:#8a93a5;stroke-dasharray:3 3}\
.fig .a{stroke:#1d5fd1}.fig .b{stroke:#c25e00}.fig .c{stroke:#7c8496}\
.fig .fa{fill:#1d5fd1}.fig .fb{fill:#c25e00}.fig .fc{fill:#7c8496}\
.fig .ink{stroke:#1f2430;stroke-width:1.4}.fig .fink{fill:#1f2430}\
.fig path,.fig line{fill:none}\
@media(prefers-color-scheme:dark){\
.fig .bg{fill:#14171d}.fig text{fill:#e6e9ef}.fig .soft{fill:#a3acbd}\
.fig .grid{stroke:#2a303b}.fig .axis{stroke:#6f7888}.fig .bound{stroke:#8a93a5}\
.fig .a{stroke:#76a9ff}.fig .b{stroke:#ffa552}.fig .c{stroke:#8a93a5}\
.fig .fa{fill:#76a9ff}.fig .fb{fill:#ffa552}.fig .fc{fill:#8a93a5}\
.fig .ink{stroke:#e6e9ef}.fig .fink{fill:#e6e9ef}}";

/// Where text is anchored.
#[derive(Clone, Copy)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

impl Svg {
    /// `title` is what the figure shows, for readers who do not see it.
    pub(crate) fn new(width: f64, height: f64, title: &str) -> Self {
        Self { width, height, title: escape(title), body: String::new() }
    }

    pub(crate) fn text(&mut self, at: [f64; 2], anchor: Anchor, class: &str, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let [x, y] = at;
        let _ = writeln!(
            self.body,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" class=\"{class}\">{}</text>",
            escape(text)
        );
    }

    /// Text that reads upward, centered.
    pub(crate) fn upright(&mut self, [x, y]: [f64; 2], class: &str, text: &str) {
        let _ = writeln!(
            self.body,
            "<text transform=\"translate({x:.1} {y:.1}) rotate(-90)\" text-anchor=\"middle\" class=\"{class}\">{}</text>",
            escape(text)
        );
    }

    pub(crate) fn line(&mut self, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2], class: &str) {
        let _ = writeln!(
            self.body,
            "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" class=\"{class}\"/>"
        );
    }

    /// A line through points; `style` holds further attributes.
    pub(crate) fn path(&mut self, points: impl Iterator<Item = [f64; 2]>, class: &str, style: &str) {
        let mut data = String::new();
        for [x, y] in points {
            let _ = write!(data, "{}{x:.1} {y:.1}", if data.is_empty() { "M" } else { "L" });
        }
        if !data.is_empty() {
            let _ = writeln!(
                self.body,
                "<path d=\"{data}\" class=\"{class}\" stroke-linejoin=\"round\" stroke-linecap=\"round\" {style}/>"
            );
        }
    }

    pub(crate) fn dot(&mut self, [x, y]: [f64; 2], radius: f64, class: &str, style: &str) {
        let _ = writeln!(
            self.body,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" class=\"{class}\" {style}/>"
        );
    }

    pub(crate) fn rect(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2], class: &str, style: &str) {
        let _ = writeln!(
            self.body,
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" class=\"{class}\" {style}/>"
        );
    }

    /// A PNG, embedded, and known as `#id` to [`Svg::again`].
    pub(crate) fn define_image(&mut self, id: &str, [width, height]: [f64; 2], png: &[u8]) {
        let _ = writeln!(
            self.body,
            "<defs><image id=\"{id}\" width=\"{width:.1}\" height=\"{height:.1}\" preserveAspectRatio=\"none\" \
             href=\"data:image/png;base64,{}\"/></defs>",
            base64(png)
        );
    }

    /// What was defined as `id`, at a place.
    pub(crate) fn again(&mut self, id: &str, [x, y]: [f64; 2]) {
        let _ = writeln!(self.body, "<use href=\"#{id}\" x=\"{x:.1}\" y=\"{y:.1}\"/>");
    }

    pub(crate) fn finish(self) -> String {
        let Self { width, height, title, body } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"fig\" viewBox=\"0 0 {width:.0} {height:.0}\" \
             width=\"{width:.0}\" height=\"{height:.0}\" role=\"img\" aria-label=\"{title}\">\n\
             <title>{title}</title>\n<style>{STYLE}</style>\n\
             <rect class=\"bg\" width=\"{width:.0}\" height=\"{height:.0}\"/>\n{body}</svg>\n"
        )
    }
}

/// A plot's rectangle, and the numbers that it shows.
#[derive(Clone, Copy)]
pub(crate) struct Frame {
    /// Left and top, in the figure.
    pub(crate) at: [f64; 2],
    /// Width and height.
    pub(crate) size: [f64; 2],
    /// Smallest and largest number from left to right.
    pub(crate) x: [f64; 2],
    /// Smallest and largest number from bottom to top.
    pub(crate) y: [f64; 2],
}

impl Frame {
    /// Where numbers are drawn.
    pub(crate) fn place(&self, x: f64, y: f64) -> [f64; 2] {
        let part = |value: f64, [low, high]: [f64; 2]| (value - low) / (high - low).max(f64::MIN_POSITIVE);
        [self.at[0] + self.size[0] * part(x, self.x), self.at[1] + self.size[1] * (1.0 - part(y, self.y))]
    }

    /// Axes, grid lines and their numbers; `labels` says whether numbers stand at x and at y.
    pub(crate) fn axes(&self, svg: &mut Svg, x_ticks: &[f64], y_ticks: &[f64], labels: [bool; 2]) {
        let ([left, top], [width, height]) = (self.at, self.size);
        let bottom = top + height;
        for &tick in y_ticks {
            let [_, y] = self.place(self.x[0], tick);
            svg.line([left, y], [left + width, y], "grid");
            if labels[1] {
                svg.text([left - 6.0, y + 4.0], Anchor::End, "soft", &number(tick));
            }
        }
        for &tick in x_ticks {
            let [x, _] = self.place(tick, self.y[0]);
            svg.line([x, bottom], [x, bottom + 4.0], "axis");
            if labels[0] {
                svg.text([x, bottom + 17.0], Anchor::Middle, "soft", &number(tick));
            }
        }
        svg.line([left, bottom], [left + width, bottom], "axis");
        svg.line([left, top], [left, bottom], "axis");
    }
}

/// Round numbers from `low` to `high`, about `count` of them.
pub(crate) fn ticks([low, high]: [f64; 2], count: usize) -> Vec<f64> {
    let rough = (high - low) / count.max(1) as f64;
    if !(rough.is_finite() && rough > 0.0) {
        return vec![low];
    }
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|&step| step >= rough * 0.999);
    let step = step.unwrap_or(10.0 * power);
    let first = (low / step - 1e-9).ceil();
    let count = (high / step + 1e-9).floor() - first;
    (0..=count as usize).map(|index| (first + index as f64) * step).collect()
}

/// A number as short as it stays clear.
pub(crate) fn number(value: f64) -> String {
    let size = value.abs();
    let digits = if (1e-9..100.0).contains(&size) { (2.0 - size.log10().floor()) as usize } else { 0 };
    let text = format!("{value:.digits$}");
    let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    short.replace('-', "−")
}

/// Text between tags.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Source: RFC 4648.
pub(crate) fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let byte = |index: usize| u32::from(chunk.get(index).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for letter in 0..4 {
            let index = (bits >> (18 - 6 * letter)) as usize % 64;
            text.push(if letter <= chunk.len() { char::from(LETTERS[index]) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_the_standard() {
        for (plain, coded) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
        ] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks([0.0, 10.0], 5), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(ticks([-1.0, 1.0], 4), [-1.0, -0.5, 0.0, 0.5, 1.0]);
        assert_eq!(ticks([103.0, 198.0], 2), [150.0]);
        assert_eq!(ticks([3.0, 3.0], 4), [3.0]);
    }

    #[test]
    fn numbers_are_short() {
        let of = |value: f64| number(value);
        assert_eq!([of(0.0), of(-0.5), of(150.0), of(-974.61)], ["0", "−0.5", "150", "−975"]);
        assert_eq!([of(1.0), of(0.25), of(12.345), of(0.00125)], ["1", "0.25", "12.3", "0.00125"]);
    }
}
