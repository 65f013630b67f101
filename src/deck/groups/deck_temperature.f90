!> Temperatures (theory.md, section 5): a law of materials and springs says how much longer their times are, and how much larger
!> their moduli, than at its reference. A body at a temperature of its own gets materials of its own.
module deck_temperature
  use kinds, only: wp
  use deck_input, only: deck_source
  use deck_numbers, only: decades
  use deck_origin, only: origin
  use deck_parts, only: law_record
  use deck_records, only: deck_record => deck, material_record
  use errors, only: fault_list
  use text, only: to_text
  implicit none (type, external)
  private
  public :: check_shift, set_temperatures, has_shift, material_name, material_used

  real(wp), parameter :: gas = 8.314462618_wp          !! molar gas constant [J/(mol K)]
  real(wp), parameter :: zero_celsius = 273.15_wp      !! [K]

contains

  !> Keys of the law of a temperature, of a material or spring: which belong together.
  subroutine check_shift(deck)
    class(deck_source), intent(inout) :: deck
    character(*), parameter :: at(2) = [character(21) :: 'reference_temperature', 'temperature']
    integer :: k
    call deck%forbid_both('wlf', 'arrhenius', ': one law moves the times')
    if (deck%is_given('wlf') .or. deck%is_given('arrhenius') .or. deck%is_given('vertical')) then
      call deck%need('reference_temperature')
      return
    end if
    do k = 1, 2
      if (deck%is_given(trim(at(k)))) call deck%complain(trim(at(k)), trim(at(k))//' has no effect without a law of '// &
        'temperature, expected wlf, arrhenius or vertical')
    end do
  end subroutine check_shift

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
      if (law%wlf(1) > 0.0_wp) then
        if (warmer <= -law%wlf(2)) then
          problem = 'wlf has no value at '//to_text(temperature)//' C, expected a temperature above '// &
                    to_text(law%reference - law%wlf(2))//' C: reference_temperature less C2'
          return
        end if
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
    call give_own_materials(d)
    do k = 1, size(d%materials)
      associate (m => d%materials(k))
        if (m%body == 0 .or. material_used(d, k)) call set_one(m%law, m%at)
      end associate
    end do
    do k = 1, size(d%springs)
      associate (s => d%springs(k))
        call set_one(s%law, s%at)
      end associate
    end do
  contains
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

  !> Bodies at temperatures of their own: each has a copy of all materials.
  subroutine give_own_materials(d)
    type(deck_record), intent(inout) :: d
    type(material_record), allocatable :: materials(:)
    integer :: k, i, n, last
    n = size(d%materials)
    allocate (materials(n*(1 + count(d%bodies%temperature < huge(1.0_wp)))))
    materials(:n) = d%materials
    last = n
    do k = 1, size(d%bodies)
      associate (b => d%bodies(k))
        if (.not. b%temperature < huge(1.0_wp)) cycle
        b%own_materials = last
        b%element_material = b%element_material + last
        do i = 1, n
          materials(last + i) = d%materials(i)
          materials(last + i)%body = k
          materials(last + i)%law%temperature = b%temperature
        end do
        last = last + n
      end associate
    end do
    call move_alloc(materials, d%materials)
  end subroutine give_own_materials

  !> The name of a material, with that of the body that has it at a temperature of its own.
  pure character(80) function material_name(d, k) result(name)
    type(deck_record), intent(in) :: d
    integer, intent(in) :: k                           !! number of the material
    name = d%materials(k)%name
    if (d%materials(k)%body > 0) name = trim(name)//' in '//d%bodies(d%materials(k)%body)%name
  end function material_name

  !> Whether a body has a material, in its elements or their layers.
  pure logical function material_used(d, material) result(yes)
    type(deck_record), intent(in) :: d
    integer, intent(in) :: material                    !! its number
    integer :: k, e
    yes = .false.
    do k = 1, size(d%bodies)
      yes = any(d%bodies(k)%element_material == material)
      do e = 1, merge(0, size(d%bodies(k)%element_section), yes)
        yes = yes .or. any(d%sections(d%bodies(k)%element_section(e))%layers + d%bodies(k)%own_materials == material)
      end do
      if (yes) return
    end do
  end function material_used
end module deck_temperature
