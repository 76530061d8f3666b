//! Fragments of an MP4 file (`moof`): the samples of a track that no table in `moov` lists.

use super::boxes::{Wrong, boxes, find, number};
use super::samples::{Sample, Samples, end_of, one_description};

/// What holds for samples of which a fragment says nothing else (`trex`).
#[derive(Clone, Copy, Debug)]
pub(super) struct Defaults {
    track: u64,
    description: u64,
    duration: u64,
    size: u64,
    flags: u64,
}

/// Of a sample's flags: decoding cannot begin there.
const IS_NO_KEY: u64 = 0x1_0000;

impl Defaults {
    /// Those of a track; `None` if the file has no fragments.
    pub(super) fn read(movie: &[u8], track: u64) -> Result<Option<Self>, String> {
        let Ok(extends) = find(movie, b"mvex") else { return Ok(None) };
        for (name, content) in boxes(extends)? {
            if &name == b"trex" && number(content, 4, 4)? == track {
                let field = |at: usize| number(content, at, 4);
                let (description, duration) = (field(8)?, field(12)?);
                return Ok(Some(Self { track, description, duration, size: field(16)?, flags: field(20)? }));
            }
        }
        Ok(Some(Self { track, description: 1, duration: 0, size: 0, flags: 0 }))
    }

    /// Appends what a fragment holds of the track. The fragment lies at byte `at` of a file of `length` bytes.
    pub(super) fn append(
        self,
        (fragment, at): (&[u8], u64),
        length: u64,
        samples: &mut Samples,
    ) -> Result<(), Wrong> {
        let tracks = boxes(fragment)?.into_iter().filter(|(name, _)| name == b"traf");
        for (number_in_fragment, (_, track)) in tracks.enumerate() {
            let head = find(track, b"tfhd")?;
            if number(head, 4, 4)? != self.track {
                continue;
            }
            let (own, base) = self.of_head(head, at)?;
            if base.is_none() && number_in_fragment > 0 {
                let reason =
                    "an MP4 file whose fragments hold several tracks without their places is not decoded";
                return Err(Wrong::Unsupported(reason.to_owned()));
            }
            if let Ok(time) = find(track, b"tfdt") {
                let width = if number(time, 0, 1)? == 0 { 4 } else { 8 };
                samples.clock =
                    i64::try_from(number(time, 4, width)?).map_err(|_| "a fragment has no time")?;
            }
            let base = base.unwrap_or(at);
            let mut offset = base;
            for (name, run) in boxes(track)? {
                if &name == b"trun" {
                    own.append_run(run, base, &mut offset, length, samples)?;
                }
            }
        }
        Ok(())
    }

    /// With what a fragment says of its track, and the byte from which its offsets count.
    fn of_head(self, head: &[u8], at: u64) -> Result<(Self, Option<u64>), Wrong> {
        let flags = number(head, 1, 3)?;
        let (mut own, mut next) = (self, 8);
        let mut field = |flag: u64, width: usize| match flags & flag {
            0 => Ok(None),
            _ => {
                next += width;
                number(head, next - width, width).map(Some)
            }
        };
        let explicit = field(0x1, 8)?;
        own.description = field(0x2, 4)?.unwrap_or(self.description);
        own.duration = field(0x8, 4)?.unwrap_or(self.duration);
        own.size = field(0x10, 4)?.unwrap_or(self.size);
        own.flags = field(0x20, 4)?.unwrap_or(self.flags);
        one_description(own.description)?;
        let from_fragment = (flags & 0x2_0000 != 0).then_some(at);
        Ok((own, explicit.or(from_fragment)))
    }

    /// Appends the samples of a run; `offset` is where its first one lies if the run does not say it.
    fn append_run(
        self,
        run: &[u8],
        base: u64,
        offset: &mut u64,
        length: u64,
        samples: &mut Samples,
    ) -> Result<(), String> {
        let (flags, count) = (number(run, 1, 3)?, number(run, 4, 4)?);
        let mut next = 8;
        let mut field = |flag: u64| match flags & flag {
            0 => Ok(None),
            _ => {
                next += 4;
                number(run, next - 4, 4).map(Some)
            }
        };
        if let Some(shift) = field(0x1)? {
            let shift = i64::from(shift as u32 as i32);
            *offset = base.checked_add_signed(shift).ok_or("a fragment lies before the file")?;
        }
        let first_flags = field(0x4)?;
        for at in 0..count {
            let duration = field(0x100)?.unwrap_or(self.duration);
            let size = field(0x200)?.unwrap_or(self.size);
            let own_flags = field(0x400)?.or(first_flags.filter(|_| at == 0)).unwrap_or(self.flags);
            let shift = field(0x800)?.map_or(0, |shift| i64::from(shift as u32 as i32));
            if size == 0 {
                // Also bounds how many there can be.
                return Err("an image of a fragment has no bytes".to_owned());
            }
            let time = samples.clock.checked_add(shift).ok_or("an image has no time")?;
            let sample =
                Sample { offset: *offset, size: size as usize, key: own_flags & IS_NO_KEY == 0, time };
            *offset = end_of(samples.list.len(), &sample, length)?;
            samples.list.push(sample);
            samples.clock = samples.clock.checked_add(duration as i64).ok_or("an image has no time")?;
            samples.duration = samples.duration.saturating_add(duration);
        }
        Ok(())
    }
}
