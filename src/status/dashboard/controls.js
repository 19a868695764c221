// The settings as a table: each control with its name in the rig, label, help and kind. The page is
// built from it, so that no control lacks a help text.

import { stops } from './exposure.js';
import { number, percent } from './text.js';

const seconds = (v) => `${number(v)} s`;

/** Controls for daily use. */
export const DAILY = [
  {
    name: 'virtual_object_visible', label: 'Virtual objects', kind: 'switch',
    help: 'Off shows the camera’s picture unchanged. The rig goes on measuring light and pose.',
  },
  {
    name: 'shadow_strength', label: 'Shadow strength', kind: 'slider', min: 0, max: 1, step: 0.01, format: (v) => percent(v, 0),
    help: 'How dark virtual shadows are. 100 % is as measured; less is a matter of taste, not of accuracy.',
  },
  {
    name: 'light_count', label: 'Dome lights', kind: 'select', number: true,
    options: [['8', '8'], ['24', '24'], ['48', '48'], ['64', '64'], ['96', '96'], ['384', '384']],
    help: 'The measured light is represented by this many lights that cast shadows. More give smoother shadows and take longer.',
  },
  {
    name: 'indirect_light', label: 'Indirect light', kind: 'switch',
    help: 'Virtual objects and real surfaces reflect light onto each other: a red object tints the table.',
  },
  {
    name: 'exposure_mode', label: 'Exposure', kind: 'choice', options: [['off', 'Camera'], ['manual', 'Manual'], ['auto', 'Auto']],
    help: 'Camera keeps the camera’s exposure and its pixels unchanged. Manual sets it in stops. Auto follows the light that virtual lamps add.',
  },
  {
    name: 'exposure_ev', label: 'Stops', kind: 'slider', min: -8, max: 3, step: 0.1, format: stops, only: 'exposure-manual',
    help: 'Exposure relative to the camera’s. One stop doubles or halves the light.',
  },
  {
    name: 'exposure_min_ev', label: 'Minimum exposure', kind: 'slider', min: -8, max: 0, step: 0.1, format: stops, only: 'exposure-auto',
    help: 'The automatic exposure goes no lower when virtual lamps are bright.',
  },
  {
    name: 'exposure_max_ev', label: 'Maximum exposure', kind: 'slider', min: 0, max: 3, step: 0.1, format: stops, only: 'exposure-auto',
    help: 'The automatic exposure goes no higher in the dark. A higher one amplifies the camera’s noise.',
  },
  {
    name: 'exposure_key', label: 'Dark below', kind: 'slider', min: 0, max: 1, step: 0.01, format: percent, only: 'exposure-auto',
    help: 'A picture whose linear mean is below this counts as dark.',
  },
  {
    name: 'exposure_adaptation_s', label: 'Adaptation time', kind: 'slider', min: 0, max: 10, step: 0.1, format: seconds, only: 'exposure-auto',
    help: 'Time constant of the automatic exposure: after it, 63 % of a change has been made.',
  },
];

/** Controls that compare the methods of the papers. */
export const RESEARCH = [
  {
    name: 'technique', label: 'Technique', kind: 'select', slow: true,
    options: [['image-based-shadowing', 'Image-based shadowing'], ['shadowing-planes', 'Shadowing planes'], ['image-based-lighting', 'Image-based lighting']],
    help: 'Image-based shadowing (Supan 2006) casts a shadow for each dome light. Shadowing planes (Kakuta 2007) sum shadows that were baked before; the bake takes a while and can be cancelled. Image-based lighting casts no shadows.',
  },
  {
    name: 'light_placement', label: 'Light placement', kind: 'choice', options: [['adaptive', 'Adaptive'], ['grid', 'Grid']],
    help: 'Adaptive places lights at the true directions of lamps, windows and the sun. Grid is uniform, as in Supan 2006.',
  },
  {
    name: 'shadow_mode', label: 'Shadow blending', kind: 'choice', options: [['ratio', 'Ratio'], ['subtract', 'Subtract']],
    help: 'Ratio scales the light of the real surface. Subtract takes the same light from every surface, as in Supan 2006, equation 4.',
  },
  {
    name: 'reflections', label: 'Reflections', kind: 'choice', options: [['prefiltered', 'Prefiltered'], ['box', 'Box']],
    help: 'Prefiltered maps follow each material’s lobe. Box-filtered maps are those of DiVerdi 2003.',
  },
  {
    name: 'lamp_response', label: 'Lamp response', kind: 'choice', options: [['intrinsic', 'Intrinsic'], ['paper', 'Paper']],
    help: 'How real surfaces respond to virtual lamps: by their reflectance, or by N·L and the relief in the picture (DiVerdi 2004). It matters only with virtual lamps.',
  },
  {
    name: 'exposure_highlights', label: 'Highlights', kind: 'choice', options: [['estimated', 'Estimated'], ['paper', 'Paper']],
    help: 'Clipped areas in a shorter exposure: their radiance estimated from the surroundings, or bright regions darkened less (DiVerdi 2004). It matters only if the exposure is not the camera’s.',
  },
  {
    name: 'planes_shading', label: 'Plane shading', kind: 'select', only: 'planes',
    options: [['irradiance', 'Irradiance'], ['lights', 'All lights'], ['six', 'Six lights']],
    help: 'How virtual objects are shaded while shadowing planes are active: by irradiance, by all lights, or by six lights (Kakuta 2004).',
  },
  {
    name: 'planes_skip_below', label: 'Skip lights below', kind: 'slider', min: 0, max: 0.05, step: 0.001, format: percent, only: 'planes',
    help: 'Lights that contribute less than this share of all light are skipped.',
  },
  {
    name: 'planes_recompute_above', label: 'Recompute above', kind: 'slider', min: 0, max: 0.1, step: 0.001, format: percent, only: 'planes',
    help: 'A light is summed again when it changes by more than this share of all light.',
  },
];

/** Sets of values that come with the page. */
export const PRESETS = [
  ['Fast', { light_count: 24, indirect_light: false }],
  ['Fine shadows', { light_count: 384, indirect_light: true, shadow_strength: 1 }],
  ['Supan 2006', { technique: 'image-based-shadowing', light_placement: 'grid', shadow_mode: 'subtract', indirect_light: false }],
  ['Kakuta 2007', { technique: 'shadowing-planes', planes_shading: 'irradiance' }],
  ['DiVerdi 2004', { reflections: 'box', lamp_response: 'paper', exposure_highlights: 'paper' }],
];
