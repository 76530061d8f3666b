//! SVG figures: one file each, without scripts, in colors for light and dark pages, in one column on narrow screens.

use std::fmt::Write as _;

use minijinja::HtmlEscape;

/// A figure with two layouts: [`Svg::at`] places its parts in either. Lengths are in pixels; text is 12 of them high.
pub(crate) struct Svg {
    /// Width and height.
    wide: [f64; 2],
    narrow: [f64; 2],
    title: String,
    body: String,
    in_group: bool,
}

/// Colors by role, which `prefers-color-scheme` chooses, and the layout of narrow screens.
const STYLE: &str = "\
.fig{font:12px system-ui,sans-serif;background:#fff}\
.fig .bg{fill:#fff}.fig text{fill:#1f2430}.fig .soft{fill:#5b6475}.fig .strong{font-weight:600}\
.fig .grid{stroke:#e3e6ec}.fig .axis{stroke:#8a93a5}.fig .bound{stroke:#8a93a5;stroke-dasharray:3 3}\
.fig .a{stroke:#1d5fd1}.fig .b{stroke:#c25e00}.fig .c{stroke:#7c8496}\
.fig .fa{fill:#1d5fd1}.fig .fb{fill:#c25e00}.fig .fc{fill:#7c8496}\
.fig .fink{fill:#1f2430}.fig path,.fig line{fill:none}\
@media(max-width:50rem){.fig{aspect-ratio:var(--ratio);width:min(100%,var(--most));height:auto}.fig g{transform:scale(var(--scale)) translate(calc(var(--x)*1px),calc(var(--y)*1px))}}\
@media(prefers-color-scheme:dark){.fig{background:#14171d}\
.fig .bg{fill:#14171d}.fig text{fill:#e6e9ef}.fig .soft{fill:#a3acbd}\
.fig .grid{stroke:#2a303b}.fig .axis{stroke:#6f7888}.fig .bound{stroke:#8a93a5}\
.fig .a{stroke:#76a9ff}.fig .b{stroke:#ffa552}.fig .c{stroke:#8a93a5}\
.fig .fa{fill:#76a9ff}.fig .fb{fill:#ffa552}.fig .fc{fill:#8a93a5}.fig .fink{fill:#e6e9ef}}";

/// Width that narrow layouts aim at.
const NARROW: f64 = 360.0;

/// What stands for a series in the legend; class and attributes are those of the series.
#[derive(Clone, Copy)]
pub(crate) enum Mark {
    Line,
    Dot,
    Square,
}

/// An entry of a legend: mark, class, attributes, text.
pub(crate) type Entry<'a> = (Mark, &'a str, &'a str, &'a str);

/// Where text is anchored.
#[derive(Clone, Copy)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

/// Cells of one size under a legend: `columns` side by side, fewer on narrow screens.
pub(crate) struct Grid {
    pub(crate) svg: Svg,
    cell: [f64; 2],
    columns: [usize; 2],
    heads: [f64; 2],
}

impl Grid {
    pub(crate) fn new(
        title: &str,
        legend: &[Entry<'_>],
        cell: [f64; 2],
        columns: usize,
        count: usize,
    ) -> Self {
        let count = count.max(1);
        let columns = [columns, (NARROW / cell[0]).round() as usize].map(|columns| columns.clamp(1, count));
        let widths = columns.map(|columns| cell[0] * columns as f64);
        let widths = [widths[0].max(520.0), widths[1].max(NARROW)];
        let mut svg = Svg::new(title);
        let heads = svg.legend(legend, widths);
        let size = |layout: usize| {
            [widths[layout], heads[layout] + cell[1] * count.div_ceil(columns[layout]) as f64]
        };
        svg.resize([size(0), size(1)]);
        Self { svg, cell, columns, heads }
    }

    /// What follows goes into cell `index`, whose corner is the origin.
    pub(crate) fn cell(&mut self, index: usize) -> &mut Svg {
        let at = |layout: usize| {
            let (column, row) = (index % self.columns[layout], index / self.columns[layout]);
            [self.cell[0] * column as f64, self.heads[layout] + self.cell[1] * row as f64]
        };
        let (wide, narrow) = (at(0), at(1));
        self.svg.at(wide, narrow);
        &mut self.svg
    }
}

impl Svg {
    /// `title` says what the figure shows, for readers who do not see it; [`Svg::resize`] sets the size.
    pub(crate) fn new(title: &str) -> Self {
        let title = HtmlEscape(title).to_string();
        Self { wide: [0.0; 2], narrow: [0.0; 2], title, body: String::new(), in_group: false }
    }

    /// What follows is relative to these points of the two layouts.
    pub(crate) fn at(&mut self, [x, y]: [f64; 2], narrow: [f64; 2]) {
        let close = if self.in_group { "</g>" } else { "" };
        self.in_group = true;
        // The narrow layout is in its own units; `finish` knows their scale.
        let _ = writeln!(
            self.body,
            "{close}<g transform=\"translate({x:.1} {y:.1})\" style=\"--x:{:.1};--y:{:.1}\">",
            narrow[0], narrow[1],
        );
    }

    /// Entries side by side and wrapped, or one under the other on narrow screens. Returns where it ends in either.
    pub(crate) fn legend(&mut self, entries: &[Entry<'_>], widths: [f64; 2]) -> [f64; 2] {
        let (mut x, mut y) = (16.0, 22.0);
        for (index, (mark, class, style, text)) in entries.iter().enumerate() {
            let length = 48.0 + 6.4 * text.chars().count() as f64;
            if x + length > widths[0] && x > 16.0 {
                (x, y) = (16.0, y + 20.0);
            }
            self.at([x, y], [4.0, 22.0 + 20.0 * index as f64]);
            match mark {
                Mark::Line => self.path([[0.0, 0.0], [22.0, 0.0]].into_iter(), class, style),
                Mark::Dot => self.dot([11.0, 0.0], 4.0, class, style),
                Mark::Square => self.rect([4.0, -7.0], [14.0, 14.0], class, style),
            }
            self.text([28.0, 4.0], Anchor::Start, "", text);
            x += length;
        }
        [y + 18.0, 20.0 * entries.len() as f64 + 20.0]
    }

    /// Sets the sizes of the two layouts.
    pub(crate) fn resize(&mut self, [wide, narrow]: [[f64; 2]; 2]) {
        (self.wide, self.narrow) = (wide, narrow);
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
            HtmlEscape(text)
        );
    }

    /// Text that reads upward, centered.
    pub(crate) fn upright(&mut self, [x, y]: [f64; 2], class: &str, text: &str) {
        let _ = writeln!(
            self.body,
            "<text transform=\"translate({x:.1} {y:.1}) rotate(-90)\" text-anchor=\"middle\" class=\"{class}\">{}</text>",
            HtmlEscape(text)
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
             href=\"{}\"/></defs>",
            data_address("image/png", png)
        );
    }

    /// What was defined as `id`, at a place.
    pub(crate) fn again(&mut self, id: &str, [x, y]: [f64; 2]) {
        let _ = writeln!(self.body, "<use href=\"#{id}\" x=\"{x:.1}\" y=\"{y:.1}\"/>");
    }

    pub(crate) fn finish(mut self) -> String {
        if self.in_group {
            self.body += "</g>\n";
        }
        let Self { wide: [width, height], narrow, title, body, .. } = self;
        let (scale, most) = (width / narrow[0], 1.3 * narrow[0]);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"fig\" viewBox=\"0 0 {width:.0} {height:.0}\" \
             width=\"{width:.0}\" height=\"{height:.0}\" preserveAspectRatio=\"xMinYMin\" role=\"img\" aria-label=\"{title}\" \
             style=\"--ratio:{:.0}/{:.0};--most:{most:.0}px;--scale:{scale:.4}\">\n\
             <title>{title}</title>\n<style>{STYLE}</style>\n\
             <rect class=\"bg\" width=\"{width:.0}\" height=\"{height:.0}\"/>\n{body}</svg>\n",
            narrow[0], narrow[1],
        )
    }
}

/// A plot's rectangle, and the values that it shows.
#[derive(Clone, Copy)]
pub(crate) struct Frame {
    /// Left and top, in the figure.
    pub(crate) at: [f64; 2],
    /// Width and height.
    pub(crate) size: [f64; 2],
    /// Smallest and largest value from left to right.
    pub(crate) x: [f64; 2],
    /// Smallest and largest value from bottom to top.
    pub(crate) y: [f64; 2],
}

impl Frame {
    /// The point of a pair of values.
    pub(crate) fn place(&self, x: f64, y: f64) -> [f64; 2] {
        let part = |value: f64, [low, high]: [f64; 2]| (value - low) / (high - low).max(f64::MIN_POSITIVE);
        [self.at[0] + self.size[0] * part(x, self.x), self.at[1] + self.size[1] * (1.0 - part(y, self.y))]
    }

    /// Axes, grid lines and their labels.
    pub(crate) fn axes(&self, svg: &mut Svg, x_ticks: &[f64], y_ticks: &[f64]) {
        let ([left, top], [width, height]) = (self.at, self.size);
        let bottom = top + height;
        for &tick in y_ticks {
            let [_, y] = self.place(self.x[0], tick);
            svg.line([left, y], [left + width, y], "grid");
            svg.text([left - 6.0, y + 4.0], Anchor::End, "soft", &number(tick));
        }
        for &tick in x_ticks {
            let [x, _] = self.place(tick, self.y[0]);
            svg.line([x, bottom], [x, bottom + 4.0], "axis");
            svg.text([x, bottom + 17.0], Anchor::Middle, "soft", &number(tick));
        }
        svg.line([left, bottom], [left + width, bottom], "axis");
        svg.line([left, top], [left, bottom], "axis");
    }
}

/// The whole numbers among them.
pub(crate) fn whole_ticks(range: [f64; 2], count: usize) -> Vec<f64> {
    ticks(range, count).into_iter().filter(|tick| tick.fract() == 0.0).collect()
}

/// Up to `count` of `0..len`: the first, the last, and evenly between.
pub(crate) fn evenly(len: usize, count: usize) -> Vec<usize> {
    if len <= count {
        return (0..len).collect();
    }
    (0..count).map(|index| index * (len - 1) / (count - 1).max(1)).collect()
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

/// A file inside of a page: what `src` and `href` hold in place of its address. Source: RFC 2397.
pub(crate) fn data_address(kind: &str, bytes: &[u8]) -> String {
    format!("data:{kind};base64,{}", base64(bytes))
}

/// Source: RFC 4648.
fn base64(bytes: &[u8]) -> String {
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
