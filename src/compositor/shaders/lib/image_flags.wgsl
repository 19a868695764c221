// Bit flags that summarise a plane's image. Twins of the constants in `baker.rs`.

const ALL_PASS = 1u;
const PHANTOMS_PASS = 2u;
const ALL_HIDE = 4u;
const PHANTOMS_HIDE = 8u;
// Some texel faces the light.
const FACED = 16u;

// Flags of a texel from its sums: Σ w cos (1 − V) past all casters and past phantoms alone, Σ w cos
// > 0.
fn flags_of(s: vec4f) -> u32 {
    let share = s.xy / s.z;
    let half_a_step = vec2f(0.5 / 255.0);
    let some = vec2u(share < vec2f(1.0) - half_a_step) * vec2u(ALL_PASS, PHANTOMS_PASS);
    let less = vec2u(share > half_a_step) * vec2u(ALL_HIDE, PHANTOMS_HIDE);
    return FACED | some.x | some.y | less.x | less.y;
}
