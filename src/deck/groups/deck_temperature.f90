!> Temperatures (theory.md, section 5): a law of materials and springs says how much longer their times are, and how much larger
!> their moduli, than at its reference. A body at a temperature of its own gets materials of its own.
module deck_temperature
  use kinds, only: wp
  use deck_numbers, only: decades
  use deck_origin, only: origin
  use deck_parts, only: law_record
  use deck_records, only: body_record, deck_record => deck, material_record
  use errors, only: fault_list
  use text, only: to_text
  implicit none (type, external)
  private
  public :: set_temperatures, warm, has_shift

  real(wp), parameter :: gas = 8.314462618_wp          !! R of theory.md, the molar gas constant [J/(mol K)]
  real(wp), parameter :: zero_celsius = 273.15_wp      !! 0 C in kelvin [K]

contains

  !> Whether anything depends on the temperature.
  elemental logical function has_shift(law) result(yes)
    type(law_record), intent(in) :: law
    yes = max(law%wlf(1), law%arrhenius, abs(law%vertical)) > 0.0_wp
  end function has_shift

  !> Sets the temperature of a law. What it says there must be a number: a problem is told, and the law left as it was.
  pure subroutine shift_law(law, temperature, problem)
    type(law_record), intent(inout) :: law
    real(wp), intent(in) :: temperature                !! [C]
    character(:), allocatable, intent(out) :: problem  !! empty: none
    real(wp) :: shift                                  ! log10 a_T [-]
    problem = ''
    shift = 0.0_wp
    associate (warmer => temperature - law%reference)
      if (law%wlf(1) > 0.0_wp .and. warmer <= -law%wlf(2)) then
        problem = 'wlf has no value at '//to_text(temperature)//' C, expected a temperature above '// &
                  to_text(law%reference - law%wlf(2))//' C: reference_temperature less C2'
        return
      else if (law%wlf(1) > 0.0_wp) then
        shift = -law%wlf(1)*warmer/(law%wlf(2) + warmer)
      else if (law%arrhenius > 0.0_wp) then
        shift = law%arrhenius/(gas*log(10.0_wp))*(1/(temperature + zero_celsius) - 1/(law%reference + zero_celsius))
      end if
      if (abs(shift) > decades) problem = 'the law of temperature moves times by more than 60 decades at '// &
        to_text(temperature)//' C, expected a temperature nearer to '//to_text(law%reference)//' C'
      if (1 + law%vertical*warmer <= 0.0_wp) problem = 'vertical leaves no stiffness at '//to_text(temperature)// &
        ' C, expected 1 + vertical (T - reference_temperature) > 0'
      if (len(problem) > 0) return
      law%temperature = temperature
      law%slower = 10.0_wp**shift
      law%stiffer = 1 + law%vertical*warmer
    end associate
  end subroutine shift_law

  !> Gives all laws of a deck that is read their temperatures, and bodies at temperatures of their own their own materials.
  subroutine set_temperatures(d, faults)
    type(deck_record), intent(inout) :: d
    type(fault_list), intent(inout) :: faults
    integer :: k
    if (faults%count > 0) return
    do k = 1, size(d%bodies)
      if (.not. d%bodies(k)%thermal_resistance > 0.0_wp) cycle
      if (.not. d%bodies(k)%temperature < huge(1.0_wp)) d%bodies(k)%temperature = of_materials(d%bodies(k))
      call set_ambient(d%bodies(k)%temperature, d%bodies(k)%at)
    end do
    call give_own_materials(d)
    do k = 1, size(d%materials)
      call set_one(d%materials(k)%law, d%materials(k)%at)
    end do
    do k = 1, size(d%springs)
      if (d%springs(k)%thermal_resistance > 0.0_wp) call set_ambient(d%springs(k)%law%temperature, d%springs(k)%at)
      call set_one(d%springs(k)%law, d%springs(k)%at)
    end do
  contains
    !> What the materials of a body say of its temperature; those that state none have that of the scene.
    real(wp) function of_materials(body) result(temperature)   ! huge: nothing [C]
      type(body_record), intent(in) :: body
      real(wp) :: one                                  ! [C]
      integer :: e, i, m
      temperature = huge(1.0_wp)
      do e = 1, body%elements
        associate (list => [body%element_material(e), body%own_materials + d%sections(body%element_section(e))%layers])
          do i = 1, size(list)
            m = list(i)
            one = d%materials(m)%law%temperature
            if (.not. one < huge(1.0_wp) .and. has_shift(d%materials(m)%law)) one = d%scene%temperature
            if (.not. one < huge(1.0_wp)) cycle
            if (.not. temperature < huge(1.0_wp)) temperature = one
            if (abs(one - temperature) > 0.0_wp) then
              call body%at%blame(faults, 'thermal_resistance gives the body one temperature, but its materials state '// &
                                 to_text(temperature)//' and '//to_text(one)//' C, expected temperature of the body')
              return
            end if
          end do
        end associate
      end do
    end function of_materials

    !> The ambient temperature of a body or spring that its losses warm: what is stated for it, or that of the scene.
    subroutine set_ambient(temperature, at)
      real(wp), intent(inout) :: temperature           !! huge: not given [C]
      type(origin), intent(in) :: at                   !! its group
      if (.not. temperature < huge(1.0_wp)) temperature = d%scene%temperature
      if (.not. temperature < huge(1.0_wp)) call at%blame(faults, 'thermal_resistance without an ambient temperature, expected '// &
        'temperature of the group or of &scene')
      if (.not. d%periodic%present) call at%blame(faults, 'thermal_resistance belongs to the losses of a cycle, expected &periodic')
    end subroutine set_ambient

    !> One law: its own temperature, or that of the scene, or its reference.
    subroutine set_one(law, at)
      type(law_record), intent(inout) :: law
      type(origin), intent(in) :: at                   !! its group
      character(:), allocatable :: problem
      if (.not. law%temperature < huge(1.0_wp)) law%temperature = d%scene%temperature
      if (.not. law%temperature < huge(1.0_wp)) law%temperature = law%reference
      call shift_law(law, law%temperature, problem)
      if (len(problem) > 0) call at%blame(faults, problem)
    end subroutine set_one
  end subroutine set_temperatures

  !> Sets the temperatures of bodies with materials of their own, and of springs. Where a law has no value the problem is told.
  subroutine warm(d, part, temperature, problem)
    type(deck_record), intent(inout) :: d
    integer, intent(in) :: part(:)                     !! numbers of bodies, or of springs behind all bodies
    real(wp), intent(in) :: temperature(:)             !! of each [C]
    character(:), allocatable, intent(out) :: problem  !! empty: none
    integer :: k, i
    problem = ''
    do k = 1, size(part)
      if (part(k) > size(d%bodies)) call shift_law(d%springs(part(k) - size(d%bodies))%law, temperature(k), problem)
      do i = 1, size(d%materials)
        if (len(problem) > 0) return
        if (d%materials(i)%body == part(k)) call shift_law(d%materials(i)%law, temperature(k), problem)
      end do
    end do
  end subroutine warm

  !> Bodies at temperatures of their own: each has a copy of all materials. A material without use keeps no law.
  subroutine give_own_materials(d)
    type(deck_record), intent(inout) :: d
    type(material_record), allocatable :: materials(:)
    logical :: used(size(d%materials)*(1 + count(d%bodies%temperature < huge(1.0_wp))))
    integer :: k, i, n, e
    n = size(d%materials)
    allocate (materials(size(used)))
    do i = 1, size(used)
      materials(i) = d%materials(1 + mod(i - 1, n))
    end do
    used = .false.
    i = 0
    do k = 1, size(d%bodies)
      associate (b => d%bodies(k))
        if (b%temperature < huge(1.0_wp)) then
          i = i + n
          b%own_materials = i
          b%element_material = b%element_material + i
          materials(i + 1:i + n)%body = k
          materials(i + 1:i + n)%law%temperature = b%temperature
        end if
        used(b%element_material) = .true.
        do e = 1, b%elements
          used(b%own_materials + d%sections(b%element_section(e))%layers) = .true.
        end do
      end associate
    end do
    do i = 1, size(used)
      materials(i)%label = materials(i)%name
      if (materials(i)%body > 0) materials(i)%label = trim(materials(i)%name)//' in '//d%bodies(materials(i)%body)%name
      if (.not. used(i)) materials(i)%law%wlf = 0.0_wp
      if (.not. used(i)) materials(i)%law%arrhenius = 0.0_wp
      if (.not. used(i)) materials(i)%law%vertical = 0.0_wp
    end do
    call move_alloc(materials, d%materials)
  end subroutine give_own_materials
end module deck_temperature
