# completion of biela's command line for bash
_biela() {
  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]}
  # keys
  local words="\
include file prefix set parameter name value scene title gravity temperature material density young shear_modulus
poisson ghm_alpha ghm_zeta ghm_omega prony_alpha prony_tau ghm_frequency_scale wlf arrhenius vertical
reference_temperature band rayleigh_mass rayleigh_stiffness section shape width height diameter outer inner area
inertia layers thickness base cores core_stretch shear shear_factor history kind argument coefficients offset
amplitude frequency phase start_value end_value start finish time_scale value_scale time_shift columns time
interpolation ends histories factors level durations periodic profile radius hollow x y closed scale follower
base_radius clockwise arm pivot body position angle velocity angular_velocity mass com length elements node_x node_y
element_nodes thermal_resistance element_section slip_held element_material flexible viscoelastic modulus_at axial
stiffening modes static_shapes reference reference_node reference_dof lump node at point joint type body_a node_a
at_a point_a body_b node_b at_b point_b body_c node_c at_c direction ratio friction friction_static preload
preload_static pin_radius pad_distance face drive rate relative force fx fy axes moment centre controller stage
spring characteristic stiffness damping free_length free_angle stop lower upper gap exponent restitution sensor
quantity modulus element along layer index accuracy floor kp ki kd filter windup_time sample delay static load_steps
tolerance modal frequency_response spacing from to points input period period_guess multipliers most_turns moves_on
angle_repeats transient t_end method step first_step max_step spectral_radius accept_unstable check_error
check_reduction check_mesh most_seconds output_step checkpoint_interval motion_step stabilization baumgarte_alpha
baumgarte_beta"
  # end of keys
  case $before in
    --help|-h) COMPREPLY=($(compgen -W "$words" -- "$word")); return ;;
    --output|-o|--orbit) COMPREPLY=($(compgen -d -- "$word")); return ;;
    --set) compopt -o nospace 2>/dev/null   # the parameters of decks that stand on the line already
      COMPREPLY=($(compgen -S = -W "$(grep -his '^ *&parameter ' -- "${COMP_WORDS[@]:1}" |
        sed -n "s/.*name *= *['\"]\([A-Za-z][A-Za-z0-9_]*\)['\"].*/\1/p")" -- "$word")); return ;;
    --jobs|-j) COMPREPLY=($(compgen -W "1 2 4 8 16 $(nproc 2>/dev/null)" -- "$word")); return ;;
  esac
  if [[ $word == -* ]]; then
    COMPREPLY=($(compgen -W "--check --flat --json --jobs --orbit --output --restart --set --quiet --version --help" -- "$word"))
  else
    compopt -o filenames 2>/dev/null
    COMPREPLY=($(compgen -f -X '!*.nml' -- "$word") $(compgen -d -- "$word"))
  fi
}
complete -F _biela biela
