!> Texts of namelist groups from which tests make their models.
module model_texts
   use law_examples_of_table, only: law_examples
   use user_law_paths, only: user_law_samples
   implicit none
   private
   public :: law_example, law_place, one_group_a_line, paper_beam

   !> The paper's beam with its two loads; tones, harmonics and laws are still to be added.
   character(*), parameter :: paper_beam = &
      "&structure type='beam' length=1 bending_stiffness=1750 mass_per_length=7.8 n_elements=4 damping_diagonal=1 / "// &
      "&load dof='v3' tuple=1,0 cos=100 / &load dof='v3' tuple=0,1 cos=100 / "

contains

   !> Keys of a law with typical parameters, without the place where its first coordinate acts; a second one is at `x2`: the
   !> example of the table of laws.
   pure function law_example(name) result(keys)
      character(*), intent(in) :: name
      character(:), allocatable :: keys
      character(*), parameter :: library = "{samples}"
      integer :: start

      keys = example_of(name)
      keys = keys(index(keys, " ") + 1:)
      start = index(keys, library)
      if (start > 0) keys = keys(:start - 1)//user_law_samples//keys(start + len(library):)
   end function law_example

   !> Where a law of `law_example` acts in a structure that has x1 and x2.
   pure function law_place(name) result(keys)
      character(*), intent(in) :: name
      character(:), allocatable :: keys

      keys = example_of(name)
      keys = keys(:index(keys, " ") - 1)
   end function law_place

   !> The example of a law; one blank if the table has no such law.
   pure function example_of(name) result(keys)
      character(*), intent(in) :: name
      character(:), allocatable :: keys
      integer :: i

      keys = " "
      do i = 1, size(law_examples)
         if (index(law_examples(i), trim(name)//" | ") == 1) keys = trim(law_examples(i)(len_trim(name) + 4:))
      end do
   end function example_of

   !> Breaks the text after each group, as a namelist file needs it.
   pure function one_group_a_line(text) result(lines)
      character(*), intent(in) :: text
      character(:), allocatable :: lines
      integer :: i

      lines = text
      do i = 1, len(lines) - 2
         if (lines(i:i + 2) == "/ &") lines(i + 1:i + 1) = new_line("a")
      end do
   end function one_group_a_line

end module model_texts
