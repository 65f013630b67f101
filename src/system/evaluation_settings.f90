!> Settings of an evaluation beside the mechanism and its state.
module evaluation_settings
  use kinds, only: wp
  use force_element, only: stage_transient
  use scene_model, only: scene
  implicit none (type, external)
  private
  public :: evaluation_options, usual_options, at_side, with_weak_pivots

  !> Loads that act, and on which side of a jump.
  type :: evaluation_options
    real(wp) :: gravity(2) = 0.0_wp             !! [m/s2]
    real(wp) :: load_factor = 1.0_wp            !! fraction of the loads that acts [-]
    real(wp) :: prestress = 1.0_wp              !! fraction of the springs' prestress that acts [-]
    integer :: stage = stage_transient          !! the analysis: a stage of `force_element`
    logical :: controlled = .true.              !! controllers are switched on: from the end of a static analysis on
    logical :: left_limit = .false.             !! jumps of histories at the time of evaluation do not act yet
    real(wp) :: baumgarte(2) = 0.0_wp           !! alpha, beta [1/s]
    logical :: accept_weak_pivots = .false.     !! solves the joints' equations as they are, however nearly singular
  end type evaluation_options

contains

  !> As the deck has it: its gravity, all prestress, the loads of a transient.
  pure type(evaluation_options) function usual_options(s) result(options)
    type(scene), intent(in) :: s
    options%gravity = s%gravity
  end function usual_options

  !> The same, before or after a jump at the time of evaluation.
  pure type(evaluation_options) function at_side(options, left_limit) result(same)
    type(evaluation_options), intent(in) :: options
    logical, intent(in) :: left_limit
    same = options
    same%left_limit = left_limit
  end function at_side

  !> The same for a nearly singular position through which no motion passes: the joints' equations are solved as they are.
  pure type(evaluation_options) function with_weak_pivots(options) result(same)
    type(evaluation_options), intent(in) :: options
    same = options
    same%accept_weak_pivots = .true.
  end function with_weak_pivots
end module evaluation_settings
