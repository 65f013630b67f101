!> Changes of a deck that lift what limits an explicit step, body by body, and their names in the advice.
module deck_changes
  use kinds, only: wp
  use deck_mesh, only: set_elements
  use deck_records, only: deck
  use text, only: either, to_text
  implicit none (type, external)
  private
  public :: can_change, change_body, change_words

  integer, parameter, public :: without_axial = 1, half_elements = 2, two_modes = 3, rigid = 4, without_ghm = 5, &
                                without_rayleigh = 6
  integer, parameter, public :: mode_changes(4) = [without_axial, half_elements, two_modes, rigid]   !! where a mode limits

contains

  !> Whether a change applies to a body.
  pure logical function can_change(d, b, change) result(yes)
    type(deck), intent(in) :: d
    integer, intent(in) :: b                   !! body
    integer, intent(in) :: change
    associate (r => d%bodies(b))
      yes = r%kind /= 'rigid' .and. r%flexible
      if (.not. yes) return
      select case (change)
      case (without_axial)
        yes = r%kind == 'beam' .and. r%axial .and. .not. r%stiffening
      case (half_elements)
        yes = r%kind == 'beam' .and. r%elements > 1 .and. r%modes == 0
      case (two_modes)
        yes = r%modes == 0 .and. .not. r%stiffening
      case (without_ghm)
        yes = r%viscoelastic
      case (rigid)
        yes = .true.
      case default                             ! without_rayleigh
        yes = any(d%materials(r%element_material)%rayleigh_stiffness > 0.0_wp) .or. &
              any(d%materials(r%element_material)%rayleigh_mass > 0.0_wp)
      end select
    end associate
  end function can_change

  !> Makes a change on one body; without Rayleigh damping all bodies of its materials are.
  subroutine change_body(d, b, change)
    type(deck), intent(inout) :: d
    integer, intent(in) :: b                   !! body
    integer, intent(in) :: change
    integer :: k
    if (size(d%controllers) > 0) then          ! explicit steps are limited by fast motions, controllers are slow
      d%forces%controller = 0
      deallocate (d%controllers)
      allocate (d%controllers(0))
    end if
    do k = 1, size(d%forces)                   ! coordinates change their numbers
      associate (sensor => d%forces(k)%argument%sensor)
        if (sensor == 0) cycle
        if (d%sensors(sensor)%quantity == 'coordinate' .and. d%sensors(sensor)%marker%body == b) sensor = 0
      end associate
    end do
    select case (change)
    case (without_axial)
      d%bodies(b)%axial = .false.
    case (half_elements)
      call set_elements(d, b, (d%bodies(b)%elements + 1)/2)
    case (two_modes)
      d%bodies(b)%modes = 2
    case (rigid)
      d%bodies(b)%flexible = .false.
    case (without_ghm)
      d%bodies(b)%viscoelastic = .false.
    case default                               ! without_rayleigh
      d%materials(d%bodies(b)%element_material)%rayleigh_stiffness = 0.0_wp
      d%materials(d%bodies(b)%element_material)%rayleigh_mass = 0.0_wp
    end select
  end subroutine change_body

  !> A change in words, with the bodies that it concerns.
  function change_words(d, changed, change) result(text)
    type(deck), intent(in) :: d                !! changed
    logical, intent(in) :: changed(:)          !! (bodies)
    integer, intent(in) :: change
    character(:), allocatable :: text, on
    integer, parameter :: most = 3             ! bodies named
    integer :: b, n
    n = 0
    on = merge('body  ', 'bodies', count(changed) == 1)
    on = trim(on)
    do b = 1, size(changed)
      if (.not. changed(b)) cycle
      n = n + 1
      if (n <= most) on = on//either(',', '', n > 1)//' "'//trim(d%bodies(b)%name)//'"'
      if (n == 1) text = to_text(d%bodies(b)%elements)//merge(' element ', ' elements', d%bodies(b)%elements == 1)
    end do
    if (n > most) on = on//' and '//to_text(n - most)//' more'
    select case (change)
    case (without_axial)
      text = 'with axial=.false. on '//on
    case (half_elements)
      text = 'with '//trim(text)//' on '//on
    case (two_modes)
      text = 'with modes=2 on '//on
    case (rigid)
      text = 'with '//on//' rigid'
    case (without_ghm)
      text = 'without GHM in '//on
    case default
      text = 'without the Rayleigh damping of '//on
    end select
  end function change_words
end module deck_changes
