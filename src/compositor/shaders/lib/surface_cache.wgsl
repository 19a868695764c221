// Light that is kept on surfaces: pages of texels in an atlas. Twin of `surface_light`.

// Per cell of the charts: 0, or the number of its page plus one in the lowest 16 bits, the page's
// level in the next four, and the cell's place on the page in four bits each for x and y.
@group(0) @binding(11) var page_table: texture_2d<u32>;
// On real surfaces the light that virtual objects block, on virtual ones the irradiance times a
// weight, and that weight.
@group(0) @binding(12) var cache_first: texture_2d<f32>;
// On real surfaces the light that arrives, and the fraction of the unshadowed light that it is.
@group(0) @binding(13) var cache_second: texture_2d<f32>;

// Texels along a side of a page, and with its border.
const PAGE = 16.0;
const BORDERED = 18.0;
// Logarithm of the number of pages in a row of the atlas.
const PAGES_LOG = 6u;
// Steps per texel in which places are stored.
const PLACE_STEPS = 32.0;

// Place in the atlas for a fragment at `at` cells of a chart, of which `chart` has the first cell in
// the table and the number of cells; 0 without a page.
fn place_of(at: vec2f, chart: vec4u) -> vec2u {
    let cell = floor(at);
    let inside = all(at >= vec2f(0.0)) & all(cell < vec2f(chart.zw));
    let c = vec2i(clamp(cell, vec2f(0.0), max(vec2f(chart.zw) - 1.0, vec2f(0.0))));
    let entry = textureLoad(page_table, vec2i(chart.xy) + c, 0).x;
    let offset = vec2f(vec2u(entry >> 20u, entry >> 24u) & vec2u(15u));
    let scale = exp2(-f32((entry >> 16u) & 15u));
    let on_page = (offset + at - cell) * scale;
    let number = (entry & 0xffffu) - 1u;
    let slot = vec2f(vec2u(number & ((1u << PAGES_LOG) - 1u), number >> PAGES_LOG));
    let texel = slot * BORDERED + 1.0 + on_page * PAGE;
    return select(vec2u(0u), vec2u(texel * PLACE_STEPS), inside & (entry != 0u));
}

// Texture coordinates of a place.
fn cache_uv(place: vec2u) -> vec2f {
    let size = vec2f(textureDimensions(cache_first));
    return (vec2f(place) + 0.5) / (PLACE_STEPS * size);
}

// Irradiance on a virtual surface; unshadowed without a page.
fn cached_irradiance(place: vec2u, n: vec3f) -> vec3f {
    let kept = textureSampleLevel(cache_first, table_sampler, cache_uv(place), 0.0);
    let unshadowed = sky_irradiance(n) + by_normal(irradiance_of_compact, n);
    return select(unshadowed, kept.rgb / max(kept.a, 1e-4), place.x != 0u);
}
