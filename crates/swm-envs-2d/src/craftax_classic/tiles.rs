//! The tiles of which images consist: 7 × 7 px each, drawn for this crate. A character is a color, a point nothing.

/// The side of a tile, px.
pub(super) const TILE_PX: usize = 7;
/// The side of an icon of the inventory, px.
pub(super) const ICON_PX: usize = 5;
/// The side of a digit, px.
pub(super) const DIGIT_PX: usize = 4;

/// A tile, icon or digit: rows of as many characters.
pub(super) type Art<const N: usize> = [&'static [u8; N]; N];

/// The color of a character; none where what is below shows.
pub(super) fn color(of: u8) -> Option<[u8; 3]> {
    Some(match of {
        b'g' => [106, 162, 74],
        b'G' => [90, 144, 62],
        b'w' => [64, 118, 190],
        b'W' => [104, 156, 216],
        b's' => [130, 130, 132],
        b'S' => [102, 102, 106],
        b'l' => [62, 134, 58],
        b'L' => [42, 106, 46],
        b'o' => [164, 122, 72],
        b'O' => [120, 84, 48],
        b'p' => [198, 178, 142],
        b'P' => [180, 160, 124],
        b'k' => [28, 28, 32],
        b'i' => [222, 172, 138],
        b'd' => [214, 240, 250],
        b'D' => [130, 206, 232],
        b'y' => [226, 212, 152],
        b'Y' => [208, 192, 130],
        b'r' => [226, 84, 24],
        b'R' => [250, 172, 48],
        b'n' => [70, 196, 66],
        b'm' => [240, 116, 164],
        b'z' => [84, 142, 78],
        b'Z' => [46, 84, 52],
        b'b' => [122, 72, 42],
        b'e' => [242, 242, 242],
        b'h' => [232, 192, 152],
        b'u' => [44, 92, 200],
        b'U' => [34, 48, 104],
        b'H' => [214, 40, 62],
        b'x' => [128, 128, 128],
        _ => return None,
    })
}

/// The blocks, by their numbers. The first and wood are in no world.
pub(super) const BLOCKS: [Art<TILE_PX>; 17] = [
    [b"mmmkkkk", b"mmmkkkk", b"mmmkkkk", b"kkkmmmm", b"kkkmmmm", b"kkkmmmm", b"kkkmmmm"],
    [b"xxxxxxx"; TILE_PX],
    [b"ggggggg", b"gGggggg", b"ggggGgg", b"ggggggg", b"ggGgggg", b"ggggggG", b"ggggggg"],
    [b"wwwwwww", b"wWWwwww", b"wwwwwww", b"wwwwWWw", b"wwwwwww", b"wWWwwww", b"wwwwwww"],
    [b"sssssss", b"sSSssss", b"ssssSSs", b"sssssss", b"SSssssS", b"sssSSss", b"sssssss"],
    [b"gLLLLLg", b"LLlLLLL", b"LLLLlLL", b"LlLLLLL", b"gLLLLLg", b"ggGOGgg", b"gggOggg"],
    [b"ooooooo", b"OOOOOOO", b"ooooooo", b"ooooooo", b"OOOOOOO", b"ooooooo", b"OOOOOOO"],
    [b"ppppppp", b"pPppppp", b"ppppPpp", b"ppppppp", b"ppPpppp", b"pppppPp", b"ppppppp"],
    [b"sssssss", b"skkssss", b"skkssks", b"sssssss", b"ssskkss", b"sksskss", b"sssssss"],
    [b"sssssss", b"sissiis", b"ssssiis", b"siissss", b"siissis", b"sssssss", b"sssssss"],
    [b"sssssss", b"ssdddss", b"sdDdDds", b"sdddDds", b"ssdDdss", b"sssdsss", b"sssssss"],
    [b"ooooooo", b"oOOoOOo", b"oOsoOio", b"ooooooo", b"OOOOOOO", b"oOooOoo", b"ooooooo"],
    [b"SSSSSSS", b"SsssssS", b"SsssssS", b"SskkksS", b"SkRRRkS", b"SkrRrkS", b"SSSSSSS"],
    [b"yyyyyyy", b"yYyyyyy", b"yyyyyYy", b"yyYyyyy", b"yyyyyyy", b"yyyyYyy", b"yyyyyyy"],
    [b"rrrrrrr", b"rRRrrrr", b"rrrrrRr", b"rrrrrrr", b"rrRRrrr", b"rrrrrrR", b"rrrrrrr"],
    [b"ggggggg", b"ggggggg", b"ggnggng", b"gggnngg", b"gggnggg", b"ggOOOgg", b"ggggggg"],
    [b"ggmgggg", b"gmmmgmg", b"ggnggng", b"gggnngg", b"gggnggg", b"ggOOOgg", b"ggggggg"],
];

/// The player, who looks left, right, up, down, and asleep.
pub(super) const PLAYER: [Art<TILE_PX>; 5] = [
    [b".......", b"..OOO..", b"..hhO..", b"..hhO..", b".huuu..", b"..uuu..", b"..U.U.."],
    [b".......", b"..OOO..", b"..Ohh..", b"..Ohh..", b"..uuuh.", b"..uuu..", b"..U.U.."],
    [b".......", b"..OOO..", b"..OOO..", b"..OOO..", b".huuuh.", b"..uuu..", b"..U.U.."],
    [b".......", b"..OOO..", b"..hhh..", b"..khk..", b".huuuh.", b"..uuu..", b"..U.U.."],
    [b".......", b".......", b".......", b"OOh....", b"Ohhuuu.", b"OOhuuuU", b"......."],
];

pub(super) const ZOMBIE: Art<TILE_PX> =
    [b".......", b"..zzz..", b"..kzk..", b"..zzz..", b"zzZZZzz", b"..ZZZ..", b"..z.z.."];
pub(super) const COW: Art<TILE_PX> =
    [b".......", b".......", b"ee.....", b"ebbbebb", b"ebbeebb", b"..bbbb.", b"..e..e."];
pub(super) const SKELETON: Art<TILE_PX> =
    [b".......", b"..eee..", b"..kek..", b"..eee..", b".e.e.e.", b"..eee..", b"..e.e.."];
/// An arrow that flies up.
pub(super) const ARROW: Art<TILE_PX> =
    [b"...s...", b"..sss..", b"...O...", b"...O...", b"...O...", b"..e.e..", b"......."];

/// Health, food, drink, energy, and the inventory without tools: sapling, wood, stone, coal, iron, diamond.
pub(super) const GOODS: [Art<ICON_PX>; 10] = [
    [b"H...H", b"HHHHH", b"HHHHH", b".HHH.", b"..H.."],
    [b".bbb.", b"bbbbb", b"bbbb.", b".bbe.", b"...ee"],
    [b"..w..", b".www.", b"wWwww", b"wWwww", b".www."],
    [b"...R.", b"..RR.", b".RRR.", b".RR..", b".R..."],
    [b"n...n", b".n.n.", b"..n..", b"..n..", b".OOO."],
    [b"ooooo", b"OOOOO", b"ooooo", b"OOOOO", b"ooooo"],
    [b"sssss", b"sSsss", b"sssSs", b"sssss", b"sSsss"],
    [b".kkk.", b"kkkkk", b"kkSkk", b"kkkkk", b".kkk."],
    [b".iii.", b"iieii", b"iiiii", b"iiiii", b".iii."],
    [b".ddd.", b"dDdDd", b"dddDd", b".dDd.", b"..d.."],
];
/// What a pickaxe and a sword look like; `e` is what they are made of.
pub(super) const PICKAXE: Art<ICON_PX> = [b".eee.", b"e.O.e", b"..O..", b"..O..", b"..O.."];
pub(super) const SWORD: Art<ICON_PX> = [b"....e", b"...e.", b"..e..", b"Oe...", b".O..."];
/// Characters of what tools are made of: wood, stone, iron.
pub(super) const MADE_OF: [u8; 3] = *b"osi";

/// The digits 1 to 9.
pub(super) const DIGITS: [Art<DIGIT_PX>; 9] = [
    [b"..e.", b".ee.", b"..e.", b"..e."],
    [b".ee.", b"...e", b"..e.", b".eee"],
    [b".eee", b"..ee", b"...e", b".eee"],
    [b".e.e", b".e.e", b".eee", b"...e"],
    [b".eee", b".e..", b"..ee", b".ee."],
    [b".e..", b".eee", b".e.e", b".eee"],
    [b".eee", b"...e", b"..e.", b"..e."],
    [b".eee", b".e.e", b".eee", b".eee"],
    [b".eee", b".e.e", b".eee", b"...e"],
];
