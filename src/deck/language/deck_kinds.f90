!> The groups that a deck may hold.
module deck_kinds
  use text, only: digits, letters, lower
  implicit none (type, external)
  private
  public :: group_number

  integer, parameter, public :: in_include = 1, in_parameter = 2, in_scene = 3, in_material = 4, in_section = 5, &
    in_history = 6, in_body = 7, in_lump = 8, in_joint = 9, in_drive = 10, in_force = 11, in_spring = 12, in_stop = 13, &
    in_sensor = 14, in_controller = 15, in_static = 16, in_modal = 17, in_response = 18, in_transient = 19
  integer, parameter, public :: group_kinds = 19

  !> The word after `&`.
  character(18), parameter, public :: group_names(group_kinds) = [character(18) :: 'include', 'parameter', 'scene', &
    'material', 'section', 'history', 'body', 'lump', 'joint', 'drive', 'force', 'spring', 'stop', 'sensor', 'controller', &
    'static', 'modal', 'frequency_response', 'transient']

  integer :: k

  !> Groups that stand in a deck at most once.
  logical, parameter, public :: is_single(group_kinds) = &
    [(any(k == [in_scene, in_static, in_modal, in_response, in_transient]), k=1, group_kinds)]

  !> Groups with a name that is unique among the groups of their kind.
  logical, parameter, public :: is_named(group_kinds) = &
    [(.not. (is_single(k) .or. k == in_include .or. k == in_lump), k=1, group_kinds)]

  !> What a name may consist of, in lower case.
  character(*), parameter, public :: name_characters = letters//digits//'_-'

contains

  !> Number of the group with this name, 0 if there is none.
  pure integer function group_number(word) result(kind)
    character(*), intent(in) :: word   !! the word after `&`, any case
    kind = findloc(group_names == lower(word), .true., 1)
  end function group_number
end module deck_kinds
