!> The groups that a deck may hold.
module deck_kinds
  use text, only: lower
  implicit none (type, external)
  private
  public :: group_number

  integer, parameter, public :: in_include = 1, in_scene = 2, in_material = 3, in_section = 4, in_history = 5, &
    in_body = 6, in_lump = 7, in_joint = 8, in_drive = 9, in_force = 10, in_spring = 11, in_stop = 12, &
    in_sensor = 13, in_static = 14, in_modal = 15, in_response = 16, in_transient = 17
  integer, parameter, public :: group_kinds = 17

  !> The word after `&`.
  character(18), parameter, public :: group_names(group_kinds) = [character(18) :: 'include', 'scene', 'material', &
    'section', 'history', 'body', 'lump', 'joint', 'drive', 'force', 'spring', 'stop', 'sensor', 'static', &
    'modal', 'frequency_response', 'transient']

  !> Groups that stand in a deck at most once.
  logical, parameter, public :: is_single(group_kinds) = [.false., .true., .false., .false., .false., .false., &
    .false., .false., .false., .false., .false., .false., .false., .true., .true., .true., .true.]

  !> Groups with a name that is unique among the groups of their kind.
  logical, parameter, public :: is_named(group_kinds) = [.false., .false., .true., .true., .true., .true., &
    .false., .true., .true., .true., .true., .true., .true., .false., .false., .false., .false.]

  !> What a name may consist of, in lower case.
  character(*), parameter, public :: name_characters = 'abcdefghijklmnopqrstuvwxyz0123456789_-'

contains

  !> Number of the group with this name, 0 if there is none.
  pure integer function group_number(word) result(kind)
    character(*), intent(in) :: word   !! the word after `&`, any case
    kind = findloc(group_names == lower(word), .true., 1)
  end function group_number
end module deck_kinds
